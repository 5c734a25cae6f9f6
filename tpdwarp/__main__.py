"""``python -m tpdwarp``, the same as the ``tpdwarp`` program."""

if __name__ == "__main__":
    import signal

    # Until the program hears signals itself, Ctrl-C ends it as any other, and not by a traceback out of an import.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)

    from tpdwarp.cli import main

    raise SystemExit(main())
