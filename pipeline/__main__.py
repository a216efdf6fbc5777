"""Entry point of the command, with everything that must happen before other imports.

Until a build begins there is nothing to tidy up, and the operating system ends the process. Python's own reaction to
Ctrl-C is an exception at any point, even during an import; libraries print it, or ignore it and go on half loaded.
"""

import signal


def main() -> None:
    """Run the command line and end the process with its exit code."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, signal.SIG_DFL)
    from pipeline.machine.process import mend_streams

    mend_streams()
    from pipeline import cli

    cli.main()


if __name__ == "__main__":
    main()
