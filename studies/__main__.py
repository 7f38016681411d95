"""`python -m studies`: the same as `jouleswarm`."""

from studies.cli import main

# The processes of a study import this module again, under another name.
if __name__ == "__main__":
    main()
