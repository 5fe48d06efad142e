"""Fuzzy rules of two inputs, worked out once into a surface that is looked up.

Sets and inference as in Jia et al. 2015 (figures 5 to 7): five sets an input, the outer ones
triangles with open shoulders, the inner ones Gaussian; min, max and centroid (Mamdani), or product
and weighted mean (Sugeno).
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from followerd import settings
from followerd.errors import ConfigError
from followerd.geometry import Array
from followerd.resources import shipped
from followerd.settings import Settings

SETS = ("NF", "NS", "Z", "PS", "PF")
CENTRES = np.array([-1.0, -0.5, 0.0, 0.5, 1.0])  # half domains
NODES = 41  # of a surface, each way
FINE = 401  # places at which an output set is sampled

Domain = tuple[float, float]
Rule = tuple[str, str, str, str, str]
Table = tuple[Rule, Rule, Rule, Rule, Rule]


class Inputs(Settings):
    """Ends of the inputs' domains."""

    ahead_m: Domain
    ahead_mps: Domain
    aside_m: Domain
    aside_mps: Domain


class Rules(Settings):
    """Everything about the two surfaces, as `config/fuzzy/*.yaml` has it."""

    inference: Literal["mamdani", "sugeno"]
    inputs: Inputs
    sigma: float = Field(gt=0, description="of the inner sets, half domains")
    speeds: dict[str, float] = Field(description="centre of each output set, 0..1")
    gears: dict[str, float] = Field(description="centre of each output set, 0..1")
    speed_rules: Table = Field(description="rows by ahead_m, columns by ahead_mps, each NF to PF")
    gear_rules: Table = Field(description="rows by aside_m, columns by aside_mps, each NF to PF")

    @model_validator(mode="after")
    def _names_are_known(self) -> "Rules":
        for table, sets in ((self.speed_rules, self.speeds), (self.gear_rules, self.gears)):
            if unknown := {name for row in table for name in row} - set(sets):
                raise ValueError(f"no output set {', '.join(sorted(unknown))}")
            if not all(0.0 <= centre <= 1.0 for centre in sets.values()):
                raise ValueError("centres of output sets lie between 0 and 1")
        domains = self.inputs.model_dump().values()
        if not all(low < high for low, high in domains):
            raise ValueError("a domain goes from its lower end to its upper one")
        return self

    def speed(self) -> "Surface":
        """Share of the fastest speed over (ahead_m, ahead_mps)."""
        domains = self.inputs.ahead_m, self.inputs.ahead_mps
        return Surface(self, *domains, self.speed_rules, self.speeds)

    def gear(self) -> "Surface":
        """Share of the largest gain over (aside_m, aside_mps)."""
        domains = self.inputs.aside_m, self.inputs.aside_mps
        return Surface(self, *domains, self.gear_rules, self.gears)


def load(name: str) -> Rules:
    """Shipped rules by name, or a YAML file (*.yaml); raises ConfigError."""
    if name.endswith((".yaml", ".yml")):
        return settings.load(Path(name), Rules)
    known = sorted(path.stem for path in shipped("fuzzy").glob("*.yaml"))
    if name not in known:
        raise ConfigError(f"controller: no rules {name}; there are {', '.join(known)}")
    return settings.load(shipped("fuzzy", f"{name}.yaml"), Rules)


def memberships(values: Array, sigma: float) -> Array:
    """How much (5, N) values (N,) in half domains belong to each of SETS."""
    grades: Array = np.exp(-0.5 * ((values - CENTRES[:, None]) / sigma) ** 2)
    grades[0] = np.clip(-1.0 - 2.0 * values, 0.0, 1.0)
    grades[-1] = np.clip(2.0 * values - 1.0, 0.0, 1.0)
    return grades


def sugeno(a: Array, b: Array, table: Table, centres: Mapping[str, float]) -> Array:
    """Weighted mean (N, M) of the rules' centres for grades `a` (5, N) and `b` (5, M)."""
    worth = np.array([[centres[name] for name in row] for row in table])
    mean: Array = (a / a.sum(axis=0)).T @ worth @ (b / b.sum(axis=0))
    return mean


def mamdani(a: Array, b: Array, table: Table, centres: Mapping[str, float]) -> Array:
    """Centroid (N, M) of the clipped output sets for grades `a` (5, N) and `b` (5, M)."""
    strength = np.minimum(a[:, None, :, None], b[None, :, None, :])  # rows, columns, N, M
    place = np.linspace(0.0, 1.0, FINE)
    reach = 1.0 / max(len(centres) - 1, 1)
    total = np.zeros((a.shape[1], b.shape[1], FINE))
    for name, centre in centres.items():
        cells = [(i, j) for i, row in enumerate(table) for j, out in enumerate(row) if out == name]
        if cells:
            rows, columns = np.array(cells).T
            height = strength[rows, columns].max(axis=0)
            triangle = np.clip(1.0 - np.abs(place - centre) / reach, 0.0, 1.0)
            np.maximum(total, np.minimum(height[..., None], triangle), out=total)
    centroid: Array = (total @ place) / total.sum(axis=2)
    return centroid


class Surface:
    """One output over two inputs: exact by `infer`, from a table of nodes by `at`."""

    def __init__(
        self, rules: Rules, first: Domain, second: Domain, table: Table, sets: Mapping[str, float]
    ) -> None:
        self._rules, self._table, self._sets = rules, table, sets
        self.first, self.second = first, second
        nodes = self.infer(np.linspace(*first, NODES), np.linspace(*second, NODES))
        # an edge is met twice, so that a value at the end of its domain has a neighbour
        self._nodes: list[list[float]] = np.pad(nodes, (0, 1), mode="edge").tolist()
        self._scale = (NODES - 1) / (first[1] - first[0]), (NODES - 1) / (second[1] - second[0])

    def infer(self, first: Array, second: Array) -> Array:
        """The output (N, M) for inputs (N,) and (M,), by the rules."""
        a, b = (
            memberships(np.clip((2.0 * value - low - high) / (high - low), -1.0, 1.0), sigma)
            for value, (low, high), sigma in (
                (first, self.first, self._rules.sigma),
                (second, self.second, self._rules.sigma),
            )
        )
        method = mamdani if self._rules.inference == "mamdani" else sugeno
        return method(a, b, self._table, self._sets)

    def at(self, first: float, second: float) -> float:
        """The output, between four nodes; inputs beyond a domain count as its end."""
        u = (min(max(first, self.first[0]), self.first[1]) - self.first[0]) * self._scale[0]
        v = (min(max(second, self.second[0]), self.second[1]) - self.second[0]) * self._scale[1]
        i, j = int(u), int(v)
        u -= i
        v -= j
        low, high = self._nodes[i], self._nodes[i + 1]
        a = low[j] + v * (low[j + 1] - low[j])
        return a + u * (high[j] + v * (high[j + 1] - high[j]) - a)
