"""The command line: what it offers, and one line per error."""

import os
import sys

from cyclopts import App, CycloptsError

from followerd import __version__
from followerd.errors import FollowerdError

COMMANDS = {  # name -> where it lives, imported only when called; one line for the overview
    "demo": ("followerd.cli.demo:demo", "Watch a simulated Pioneer follow a person."),
    "run": ("followerd.cli.run:run", "Run the daemon on a config file."),
    "sim": ("followerd.cli.sim:sim", "Offer a simulated robot's serial lines and camera."),
    "ctl": ("followerd.cli.ctl:ctl", "Speak to a running daemon: enrol, confirm, arm, stop."),
    "check": ("followerd.cli.check:check", "Validate a config file."),
    "schema": ("followerd.cli.check:schema", "Print the JSON Schema of the config."),
    "track": ("followerd.cli.track:track", "Run a tracker alone over a recording."),
    "bench": ("followerd.cli.bench:bench", "Measure trackers and the whole daemon."),
}

INTERRUPTED = 130

# before NumPy is imported: our matrices are small, and threads that help each other with them
# cost the daemon more than they save
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


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
    for name, (place, overview) in COMMANDS.items():
        app.command(place, name=name, help=overview)
    return app


def call(tokens: list[str] | None = None) -> int:
    """Run one command; the exit code is 0, or 2 usage or config, 3 device, 4 stopped by a fault."""
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
