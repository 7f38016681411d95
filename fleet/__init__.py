"""The operator's seat: starts processes, records what they do, prices and shows it."""
