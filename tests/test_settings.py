"""A wrong config file gets every fault at once, each with its place."""

from pathlib import Path
from typing import Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Field

from followerd import yaml
from followerd.errors import ConfigError
from followerd.settings import Settings, load, validate


class Cat(Settings):
    kind: Literal["cat"]
    lives: int = 9


class Dog(Settings):
    kind: Literal["dog"]
    tricks: tuple[str, ...] = ()


class Home(Settings):
    """A settings class for the tests."""

    max_speed_mps: float = Field(0.7, gt=0)
    pet: Cat | Dog = Field(Cat(kind="cat"), discriminator="kind")
    name: str


def problems(text: str) -> tuple[str, ...]:
    with pytest.raises(ConfigError) as caught:
        validate(yaml.parse(text, "home.yaml"), Home)
    return caught.value.problems


def test_every_fault_is_named_at_once_with_its_place() -> None:
    text = "max_speed_mps: -1\npet:\n  kind: cat\n  livs: 3\nspeed: 2\n"
    assert problems(text) == (
        "home.yaml:1:1: max_speed_mps: input should be greater than 0 (got -1)",
        "home.yaml:4:3: pet.livs: unknown key; did you mean lives?",
        "home.yaml:1:1: name: is required",
        "home.yaml:5:1: speed: unknown key",
    )


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("on", "on"),
        ("yes", "yes"),
        ("true", True),
        ("12:30:00", "12:30:00"),
        ("1e3", 1000.0),
        ("-.5", -0.5),
        ("7", 7),
        ("'7'", "7"),
        ("~", None),
        ("[1, a]", [1, "a"]),
    ],
)
def test_values_mean_what_they_look_like(text: str, value: object) -> None:
    assert yaml.parse(f"key: {text}", "f").value == {"key": value}


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("a: 1\na: 2", "f:2:1: a stands here twice"),
        ("a: 010", "f:1:4: 010: a number must not begin with 0"),
        ("a: [1, 2", "f:1:9: not valid YAML"),
        ("? [1]\n: 2", "f:1:3: a key must be a word"),
        ("a: \x00", "f: not valid YAML"),
    ],
)
def test_bad_yaml_is_refused_with_its_place(text: str, complaint: str) -> None:
    with pytest.raises(ConfigError, match=complaint.replace("[", r"\[")):
        yaml.parse(text, "f")


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.yaml: no such file"):
        load(tmp_path / "none.yaml", Home)


def test_a_good_file_gives_the_settings(tmp_path: Path) -> None:
    path = tmp_path / "home.yaml"
    path.write_text("name: den\npet: {kind: dog, tricks: [sit]}\n", encoding="utf-8")
    assert load(path, Home) == Home(name="den", pet=Dog(kind="dog", tricks=("sit",)))


def test_a_list_where_keys_belong_is_refused() -> None:
    with pytest.raises(ConfigError, match="expected keys and values"):
        validate(yaml.parse("[1]", "f"), Home)


@given(st.text(max_size=80))
def test_any_text_is_valid_or_a_config_error(text: str) -> None:
    faults: tuple[str, ...] = ()
    try:
        validate(yaml.parse(text, "f"), Home)
    except ConfigError as error:
        faults = error.problems
    assert all(fault.startswith("f") for fault in faults)
