"""Studies: many deployments, reduced to facts in one CSV file, then to tables and figures that need no run again."""

import fleet  # noqa: F401 - first of all, so that names of ours mean our packages
