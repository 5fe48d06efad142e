"""The config file: one schema, assembled from the settings beside what they configure."""

import json
from contextlib import suppress
from functools import cache, reduce
from operator import or_
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, ValidationInfo, create_model, model_validator

from followerd import yaml
from followerd.control.registry import CONTROLLERS
from followerd.errors import ConfigError, UsageError
from followerd.estimation.predictors import Kind
from followerd.estimation.registry import LOCALIZERS
from followerd.hw.registry import DRIVERS
from followerd.pipeline import PipelineSettings
from followerd.record.settings import RecordSettings
from followerd.registry import Registry
from followerd.resources import shipped
from followerd.settings import Settings, validate
from followerd.sim.faults import Fault
from followerd.trackers.registry import TRACKERS

SIM = "sim"  # a link or a map that the simulation offers


class DeviceSection(Settings):
    """A device: which driver, and where it is plugged in."""

    kind: str
    link: str = Field(
        description="/dev/ttyUSB0, socket://host:port, /dev/video0, ring:FILE, sim for the twin,"
        " or aux (a pan-tilt head on the base's AUX port)"
    )


class ChoiceSection(Settings):
    """A tracker or a controller."""

    kind: str


class PoseSection(Settings):
    """A place on the map."""

    x_m: float
    y_m: float
    yaw_deg: float = 0.0


def _from_the_config(path: str, info: ValidationInfo) -> str:
    """A relative path starts at the config's folder."""
    return path if path == SIM else str((info.context or {}).get("folder", Path()) / path)


ConfigPath = Annotated[str, AfterValidator(_from_the_config)]


class LocalizerSection(Settings):
    """Where the robot is on a map: which way to find out, and which map."""

    kind: str
    map: ConfigPath = Field(
        description="a map in ROS's form, a floor plan of segments, or sim for the scenario's"
    )
    start_pose: PoseSection | None = Field(
        None, description="of the robot; default: anywhere, in the simulation where it is set down"
    )


def _a_fault(text: str) -> str:
    try:
        Fault.parse(text)
    except UsageError as error:
        raise ValueError(str(error)) from None
    return text


class SimSection(Settings):
    """The simulated world behind links that say `sim`."""

    scenario: str = Field("corridor", description="a shipped scenario or a YAML file")
    faults: tuple[Annotated[str, AfterValidator(_a_fault)], ...] = Field(
        (), description="of the twins, DEVICE:NAME@STARTs+LENGTHs, such as laser:garbage@10s+2s"
    )


class WebSection(Settings):
    """The operator's page. On another address than this computer's it asks for a token."""

    host: str = Field("127.0.0.1", description="address to listen on; 0.0.0.0: all")
    port: int = Field(8080, ge=0, le=65535)
    names: tuple[str, ...] = Field((), description="further host names of this robot")
    token: str | None = Field(None, min_length=16, description="default: a new one at each start")
    certificate: ConfigPath | None = Field(None, description="TLS certificate file (PEM)")
    key: ConfigPath | None = Field(None, description="its key file, if it is not in the same")
    jpeg_quality: int = Field(75, ge=1, le=100)

    @model_validator(mode="after")
    def _is_encrypted_or_not(self) -> "WebSection":
        if self.key is not None and self.certificate is None:
            raise ValueError("web.key needs web.certificate: without one nothing is encrypted")
        return self


class Config(Settings):
    """Everything the daemon is told."""

    base: DeviceSection
    laser: DeviceSection
    camera: DeviceSection
    ptz: DeviceSection | None = Field(
        None, description="the pan-tilt head that turns the camera; its mount is that of its home"
    )
    localizer: LocalizerSection | None = None
    tracker: ChoiceSection
    controller: ChoiceSection
    pipeline: PipelineSettings = PipelineSettings()
    record: RecordSettings = RecordSettings()
    web: WebSection | None = Field(WebSection(), description="null: no page")
    shadow: tuple[Kind, ...] = Field(
        (), description="predictors of the person's direction that only run alongside"
    )
    sim: SimSection = SimSection()
    operator: Literal["manual", "auto", "watch"] = Field(
        "manual",
        description="auto: enrols whoever stands in front, confirms and arms by itself;"
        " watch: enrols and confirms, never arms",
    )
    enrol_px: tuple[float, float, float, float] | None = Field(
        None, description="x, y, w, h that auto and watch enrol instead of whoever stands in front"
    )
    seed: int = Field(0, ge=0, description="of the tracker's and the simulation's random numbers")
    image_work_s: float = Field(
        0.006, ge=0, le=1, description="modelled duration of a tracker's step in virtual time"
    )
    socket: str | None = Field(None, description="control socket; default: the runtime directory")
    log_level: Literal["debug", "info", "warning", "error"] = "info"

    @property
    def simulated(self) -> bool:
        """Whether any device is a twin."""
        devices = (self.base, self.laser, self.camera, self.ptz)
        return any(device is not None and device.link == "sim" for device in devices)


@cache
def schema(only: frozenset[str] | None = None) -> type[Config]:
    """`Config` with every registered driver, tracker and controller filled in.

    With those of the kinds `only` alone it is a fifth of a second quicker, and says of other
    kinds that they are wrong.
    """
    device = {"link": (str, DeviceSection.model_fields["link"])}
    drivers = {role: _kinds(DRIVERS, device, only, role) for role in ("base", "laser", "camera")}
    localizers = _kinds(LOCALIZERS, _fields(LocalizerSection, "map", "start_pose"), only)
    heads = _kinds(DRIVERS, device, only, "ptz")
    fields: dict[str, Any] = {
        **{role: _required(kinds) for role, kinds in drivers.items()},
        "ptz": _optional(heads, Config.model_fields["ptz"].description),
        "localizer": _optional(localizers),
        "tracker": _required(_kinds(TRACKERS, {}, only)),
        "controller": _required(_kinds(CONTROLLERS, {}, only)),
    }
    return create_model("Config", __base__=Config, **fields)


def load(path: str | Path, changes: dict[str, Any] | None = None) -> Config:
    """The config in a YAML file, or a shipped one by its name; `changes` overlay its values.

    Raises ConfigError with `file:line:column` of every fault.
    """
    place = find(path)
    return _validated(yaml.read(place), changes, place.parent)


def parse(text: str, source: str, changes: dict[str, Any] | None = None) -> Config:
    """The config in a text, such as a recording carries; as `load`."""
    return _validated(yaml.parse(text, source), changes, Path())


def with_tracker(config: Config, tracker: str) -> Config:
    """The config with another tracker, KIND or KIND/PROFILE. Raises ConfigError."""
    kind, _, profile = tracker.partition("/")
    section = {"kind": kind, **({"profile": profile} if profile else {})}
    document = config.model_dump(mode="json") | {"tracker": section}
    return parse(json.dumps(document), f"tracker {tracker}")


def find(path: str | Path) -> Path:
    """The file itself, or `config/NAME.yaml` that ships with the program."""
    if Path(path).exists() or Path(path).suffix:
        return Path(path)
    known = sorted(p.stem for p in shipped().glob("*.yaml"))
    if str(path) not in known:
        raise ConfigError(f"{path}: no such file, nor a shipped config ({', '.join(known)})")
    return shipped(f"{path}.yaml")


def _validated(document: yaml.Document, changes: dict[str, Any] | None, folder: Path) -> Config:
    if isinstance(document.value, dict):
        for dotted, value in (changes or {}).items():
            *sections, key = dotted.split(".")
            target = document.value
            for section in sections:
                target = target.setdefault(section, {})
            target[key] = value
    context = {"folder": folder}
    with suppress(ConfigError):
        return validate(document, schema(_named(document.value)), context)
    return validate(document, schema(), context)  # to say all that is possible


def _named(sections: Any) -> frozenset[str]:
    """The kinds that a document names."""
    values = sections.values() if isinstance(sections, dict) else ()
    kinds = [section.get("kind") for section in values if isinstance(section, dict)]
    return frozenset(kind for kind in kinds if isinstance(kind, str))


def _kinds(
    registry: Registry,
    extra: dict[str, Any],
    only: frozenset[str] | None,
    role: str | None = None,
) -> list[type[Settings]]:
    """One settings class per registered kind."""
    kinds = []
    for name in registry.names():
        if only is not None and name not in only:
            continue
        cls = registry.load(name)
        if role is None or cls.role == role:
            fields: dict[str, Any] = {"kind": (Literal[name], ...), **extra}
            base = cls.Settings
            kinds.append(create_model(base.__name__, __base__=base, __doc__=base.__doc__, **fields))
    return kinds


def _required(kinds: list[type[Settings]]) -> Any:
    """(type, default) of a section of one of these kinds; raises ConfigError without any."""
    if not kinds:
        raise ConfigError("a section has no kind that is known")
    discriminator = "kind" if len(kinds) > 1 else None
    return reduce(or_, kinds), Field(..., discriminator=discriminator)


def _fields(section: type[Settings], *names: str) -> dict[str, Any]:
    return {name: (f.annotation, f) for name in names if (f := section.model_fields[name])}


def _optional(kinds: list[type[Settings]], description: str | None = None) -> Any:
    """The same of a section that may be left out."""
    discriminator = "kind" if len(kinds) > 1 else None
    return reduce(or_, [*kinds, NoneType]), Field(
        None, discriminator=discriminator, description=description
    )
