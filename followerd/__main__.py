"""The command line: what it offers, and one line per error."""

import gc
import os
import sys

from cyclopts import App, CycloptsError

from followerd import __version__
from followerd.errors import FollowerdError

COMMANDS = {  # name -> where it lives, imported only when called; one line for the overview
    "demo": ("followerd.cli.demo:demo", "Watch a simulated Pioneer follow a person."),
    "run": ("followerd.cli.run:run", "Run the daemon on a config file."),
    "sim": ("followerd.cli.sim:sim", "Offer a simulated robot's serial lines and camera."),
    "fault": ("followerd.cli.sim:fault", "Let devices of a running simulation fail."),
    "ctl": ("followerd.cli.ctl:ctl", "Speak to a running daemon: enrol, confirm, arm, stop."),
    "calibrate": ("followerd.cli.calibrate:app", "Measure a camera, and where it sits."),
    "probe": ("followerd.cli.probe:probe", "Say what is plugged in, and what it answers."),
    "drive-check": (
        "followerd.cli.drive_check:drive_check",
        "Check a robot with its wheels up, before it drives for the first time.",
    ),
    "check": ("followerd.cli.check:check", "Validate a config file."),
    "schema": ("followerd.cli.check:schema", "Print the JSON Schema of the config."),
    "track": ("followerd.cli.track:track", "Run a tracker alone over a recording."),
    "replay": ("followerd.cli.replay:replay", "Run the pipeline again over a recording."),
    "info": ("followerd.cli.recordings:info", "Say what a recording holds."),
    "plot": ("followerd.cli.recordings:plot", "Draw a recording."),
    "recover": ("followerd.cli.recordings:recover", "Make a whole file of a cut-off recording."),
    "export": ("followerd.cli.bags:export", "Write a recording as a ROS 2 bag."),
    "import": ("followerd.cli.bags:import_", "Read a ROS 1 or 2 bag into a recording."),
    "map": ("followerd.cli.map:map_", "Make the map of a floor from a log or a plan."),
    "localize": (
        "followerd.cli.localize:localize",
        "Find the robot on a map, scan by scan, in a log.",
    ),
    "bench": ("followerd.cli.bench:bench", "Measure trackers and the whole daemon."),
}

INTERRUPTED = 130

gc.set_threshold(50_000, 20, 100)  # before the imports, a tenth of which it takes otherwise

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
    except BrokenPipeError:  # whoever read the output, such as head, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    return 0


def main() -> None:
    """Entry point of `followerd` and `python -m followerd`."""
    code = call()
    gc.freeze()  # else Python looks through all that a run has left behind once more
    sys.exit(code)


def _say(text: str, code: int) -> int:
    for line in filter(None, (line.strip() for line in text.splitlines())):
        print(f"followerd: {line}", file=sys.stderr)
    return code


if __name__ == "__main__":
    main()
