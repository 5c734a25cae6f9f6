"""``python -m tpdwarp``, the same as the ``tpdwarp`` program."""

from tpdwarp.cli import main

if __name__ == "__main__":
    raise SystemExit(main())
