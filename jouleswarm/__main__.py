"""`python -m jouleswarm`: the same as `jouleswarm`."""

from jouleswarm.cli.main import main

# The processes of a study import this module again, under another name.
if __name__ == "__main__":
    main()
