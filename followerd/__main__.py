"""The command line: what it offers, and one line per error."""

import sys

from cyclopts import App, CycloptsError

from followerd import __version__
from followerd.errors import FollowerdError

COMMANDS = {
    "demo": "followerd.cli.demo:demo",
    "run": "followerd.cli.run:run",
    "sim": "followerd.cli.sim:sim",
    "ctl": "followerd.cli.ctl:ctl",
    "check": "followerd.cli.check:check",
    "schema": "followerd.cli.check:schema",
    "track": "followerd.cli.track:track",
    "bench": "followerd.cli.bench:bench",
}  # imported only when called

INTERRUPTED = 130


def command_line() -> App:
    """The command line as cyclopts sees it."""
    app = App(
        name="followerd",
        help="Makes a Pioneer robot follow one chosen person.",
        version=__version__,
        print_error=False,
        exit_on_error=False,
        suppress_keyboard_interrupt=False,
        result_action="return_value",
    )
    for name, place in COMMANDS.items():
        app.command(place, name=name)
    return app


def call(tokens: list[str] | None = None) -> int:
    """Run one command; returns the exit code (2 usage or config, 3 device, 4 stopped by a fault)."""
    try:
        command_line()(tokens)
    except CycloptsError as error:
        return _say(f"{error}\nsee followerd --help", 2)
    except FollowerdError as error:
        return _say(str(error), error.exit_code)
    except KeyboardInterrupt:
        return INTERRUPTED
    return 0


def main() -> None:
    """Entry point of `followerd` and `python -m followerd`."""
    sys.exit(call())


def _say(text: str, code: int) -> int:
    for line in filter(None, (line.strip() for line in text.splitlines())):
        print(f"followerd: {line}", file=sys.stderr)
    return code


if __name__ == "__main__":
    main()
