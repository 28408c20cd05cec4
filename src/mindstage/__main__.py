"""`python -m mindstage` is the same as `mindstage`."""

from mindstage.cli import main

if __name__ == "__main__":
    main()
