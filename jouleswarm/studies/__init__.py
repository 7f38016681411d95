"""Studies: many deployments, reduced to facts in one CSV file, then to tables and figures that need no run again."""
