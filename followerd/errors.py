"""The errors a user can meet, as a tree; each says what, where and what to do.

FollowerdError
├── UsageError      a wrong argument on the command line            exit 2
├── ConfigError     a config, world or calibration file is wrong    exit 2
├── DeviceError     a device cannot be used                         exit 3
│   ├── OpenError   the link cannot be opened: missing, busy, not permitted
│   ├── SetupError  the device answers, but not as it must
│   └── LinkLost    an open link failed: unplugged, silent, hung up
└── Stopped         the run ended because of a fault                exit 4

Noise on a line is no error: decoders count it and hunt on.
"""


class FollowerdError(Exception):
    """Root of all errors that are shown to the user as one line."""

    exit_code = 1


class UsageError(FollowerdError):
    """A wrong argument on the command line."""

    exit_code = 2


class ConfigError(FollowerdError):
    """A file the user wrote is wrong; `problems` holds every fault found, one line each."""

    exit_code = 2

    def __init__(self, *problems: str) -> None:
        super().__init__("\n".join(problems))
        self.problems = problems


class DeviceError(FollowerdError):
    """A device cannot be used; `device` is its name in the config."""

    exit_code = 3

    def __init__(self, device: str, problem: str, remedy: str = "") -> None:
        super().__init__(f"{device}: {problem}" + (f"; {remedy}" if remedy else ""))
        self.device = device
        self.problem = problem
        self.remedy = remedy

    def __reduce__(self) -> tuple[type["DeviceError"], tuple[str, str, str]]:
        """Errors cross process borders in benchmarks."""
        return type(self), (self.device, self.problem, self.remedy)


class OpenError(DeviceError):
    """The link cannot be opened: it does not exist, is busy or is not permitted."""


class SetupError(DeviceError):
    """The device answers, but refuses or contradicts its set-up."""


class LinkLost(DeviceError):
    """An open link failed: unplugged, hung up or silent."""


class Stopped(FollowerdError):
    """The run ended because of a fault."""

    exit_code = 4
