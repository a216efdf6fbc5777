"""The command: what must be so before anything else is imported.

Until a build begins there is nothing to tidy up, and the kernel ends the process: Python's own answer to Ctrl-C is an
exception anywhere, in the middle of an import, which libraries print, or swallow and go on half loaded.
"""

import signal


def main() -> None:
    """Run the command line and end the process with its exit code."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, signal.SIG_DFL)
    from pipeline.machine.streams import mend

    mend()
    from pipeline import cli

    cli.main()


if __name__ == "__main__":
    main()
