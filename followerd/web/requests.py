"""What a page may ask for: every message is checked before anything is done."""

from typing import Annotated, Literal

from pydantic import Field, TypeAdapter, ValidationError

from followerd.errors import UsageError
from followerd.messages import Box
from followerd.settings import Settings

LONGEST = 4096  # bytes of a message
Pixel = Annotated[float, Field(ge=-10_000, le=10_000)]


class Ack(Settings):
    """The picture was drawn; the next one may come."""

    do: Literal["ack"]
    frame: int


class Alive(Settings):
    """The one who commands is still there."""

    do: Literal["alive"]


class Act(Settings):
    """A button; `command` takes the command over, `release` gives it up."""

    do: Literal["command", "release", "confirm", "arm", "hold", "disarm", "stop", "clear", "manual"]


class Enrol(Settings):
    """The person in the box, or under the point, of the picture that was clicked."""

    do: Literal["enrol"]
    region: Annotated[tuple[Pixel, ...], Field(min_length=2, max_length=4)]
    frame: int

    @property
    def place(self) -> Box | tuple[float, float]:
        """The region; raises UsageError."""
        if len(self.region) == 2:
            return self.region[0], self.region[1]
        if len(self.region) == 4 and min(self.region[2:]) > 0:
            return Box(*self.region)
        raise UsageError("region is [x, y] or [x, y, width, height] in pixels")


class Drive(Settings):
    """The hand on the controls; shares of the fastest that is allowed."""

    do: Literal["drive"]
    forward: float = Field(ge=-1, le=1)
    left: float = Field(ge=-1, le=1)


class Record(Settings):
    """Recording on or off."""

    do: Literal["record"]
    on: bool


class Choose(Settings):
    """Another tracker; only while disarmed."""

    do: Literal["choose"]
    tracker: str = Field(max_length=80)


Request = Annotated[Ack | Alive | Act | Enrol | Drive | Record | Choose, Field(discriminator="do")]
_REQUEST: TypeAdapter[Ack | Alive | Act | Enrol | Drive | Record | Choose] = TypeAdapter(Request)


def parse(text: str) -> Ack | Alive | Act | Enrol | Drive | Record | Choose:
    """The request in a message; raises UsageError that says what is wrong with it."""
    try:
        return _REQUEST.validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        raise UsageError(f"{where}: {first['msg']}" if where else first["msg"]) from None
