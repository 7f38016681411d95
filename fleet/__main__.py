"""`python -m fleet`: the same as `jouleswarm`."""

from fleet.cli import main

main()
