"""A correlation filter: a template that learns to answer with a peak where the person stands.

Ridge regression of a Gaussian label on all shifts of a window, solved in the Fourier domain
(MOSSE, Bolme et al. 2010; several channels as in DSST, Danelljan et al. 2014).
"""

from dataclasses import dataclass
from math import sqrt

import numpy as np
import numpy.typing as npt

from followerd.perception.gradients import Channels

Spectrum = npt.NDArray[np.complex64]
Power = npt.NDArray[np.float32]

RIDGE = 0.01  # of the mean power
LABEL = 0.1  # width of the wanted peak, of the person's size
BESIDE = 1.2  # of the person's size: what lies farther out has no say about their size
ONE, NOTHING = np.float32(1.0), np.float32(0.0)
ANCHOR = 0.2  # share of the slow memory in what leads the particles


class Fourier:
    """The real transform of n x n windows as two matrix products, twice as fast for small n."""

    def __init__(self, n: int) -> None:
        self.n, self.half = n, n // 2 + 1
        turns = np.outer(np.arange(n), np.arange(n)) / n
        wave = np.exp(-2j * np.pi * turns)
        self._rows: Spectrum = wave.astype(np.complex64)
        # a complex row is read as twice as many real numbers: real, imaginary, real ...
        self._columns = wave[:, : self.half].astype(np.complex64).view(np.float32)
        self._back: Spectrum = np.conj(self._rows) / np.float32(n * n)
        twice = np.full((self.half, 1), 2.0)  # for the other half of the spectrum
        twice[0] = twice[n - self.half + 1 :] = 1.0
        back = (twice * wave[: self.half]).astype(np.complex64)
        self._back_columns = np.ascontiguousarray(back.T).view(np.float32).T
        self._fx, self._fy = np.fft.rfftfreq(n), np.fft.fftfreq(n)
        self._fy[n // 2] = 0.0  # the highest frequency has no sign, so no direction to move in

    def __call__(self, windows: Channels) -> Spectrum:
        """Spectra (C, n, n // 2 + 1) of windows (C, n, n)."""
        columns = (windows.reshape(-1, self.n) @ self._columns).view(np.complex64)
        spectra: Spectrum = self._rows @ columns.reshape(len(windows), self.n, self.half)
        return spectra

    def inverse(self, spectrum: Spectrum) -> Power:
        """Windows (…, n, n) of spectra (…, n, n // 2 + 1)."""
        window: Power = (self._back @ spectrum).view(np.float32) @ self._back_columns
        return window

    def shift(self, x: float, y: float) -> Spectrum:
        """What multiplies a spectrum (n, n // 2 + 1) when its window moves by (x, y) cells."""
        along, down = np.exp(-2j * np.pi * x * self._fx), np.exp(-2j * np.pi * y * self._fy)
        factor: Spectrum = down.astype(np.complex64)[:, None] * along.astype(np.complex64)
        return factor


@dataclass(slots=True)
class Memory:
    """Running averages from which a filter is made."""

    numerator: Spectrum  # (C, n, n // 2 + 1)
    power: Power  # (n, n // 2 + 1)

    def learn(self, numerator: Spectrum, power: Power, rate: float) -> None:
        """Blend in one more view."""
        for known, new in ((self.numerator, numerator), (self.power, power)):
            change = new - known
            change *= np.float32(rate)
            known += change

    def blended(self, other: "Memory", share: float) -> "Memory":
        """This memory with a share of another one."""
        mixed = Memory(self.numerator.copy(), self.power.copy())
        mixed.learn(other.numerator, other.power, share)
        return mixed

    def filter(self) -> Spectrum:
        """The ridge regression's solution."""
        gain = np.reciprocal(self.power + RIDGE * self.power.mean())
        solution: Spectrum = self.numerator * gain  # much faster than dividing by a real
        return solution


class Template:
    """A filter for windows (C, cells, cells) whose middle is the person's expected place.

    A quick memory follows turns of the body and of the light; a slow one cannot be talked into
    another thing within seconds: it measures the size and vouches for the identity.
    """

    def __init__(self, channels: Channels, body: tuple[float, float]) -> None:
        """Learn the window in whose middle the person stands, `body` (w, h) cells large."""
        self._cells = cells = channels.shape[-1]
        self._fourier = Fourier(cells)
        taper = np.hanning(cells + 2)[1:-1]
        self._taper = np.outer(taper, taper).astype(np.float32)
        middle = 0.5 * (cells - 1)
        self._at = np.arange(cells, dtype=np.float32)  # columns of a tent's interpolation matrix
        self._steps = (self._at - np.float32(middle))[:, None]  # its rows
        self._spreads: dict[tuple[float, ...], Power] = {}  # from cell to cell, by zooms
        peak = np.exp(-0.5 * (self._steps[:, 0] / (LABEL * sqrt(body[0] * body[1]))) ** 2)
        self._label = self._fourier(np.outer(peak, peak).astype(np.float32)[None])[0]
        # what lies beside the person does not grow with them
        apart = np.abs(self._steps[:, 0])
        columns, rows = (np.clip(BESIDE * 0.5 * b + 0.5 - apart, 0.0, 1.0) for b in body)
        self._body = np.outer(rows, columns)
        self._to_middle = self._fourier.shift(middle, middle)
        numerator, power = self._lesson(self.spectrum(channels), (0.0, 0.0))
        self._quick = Memory(numerator, power)
        self._slow = Memory(numerator.copy(), power.copy())
        self._refresh()

    def spectrum(self, channels: Channels) -> Spectrum:
        """Of a window (C, cells, cells), faded out toward its border."""
        return self._fourier(channels * self._taper)

    def learn(
        self, spectrum: Spectrum, offset: tuple[float, float], quick: float, slow: float
    ) -> None:
        """Blend in a window in which the person stands `offset` cells (x, y) off the middle."""
        lesson = self._lesson(spectrum, offset)
        self._quick.learn(*lesson, quick)
        self._slow.learn(*lesson, slow)
        self._refresh()

    def recollect(self) -> None:
        """Forget what was learnt lately: it may have been somebody else."""
        self._quick = self._slow.blended(self._slow, 0.0)
        self._refresh()

    def respond(self, spectrum: Spectrum) -> npt.NDArray[np.float32]:
        """Answers (cells, cells): about 1 where the person stands, about 0 elsewhere."""
        return self._fourier.inverse((self._filter * spectrum).sum(axis=0))

    def vouch(self, spectrum: Spectrum, answer: float) -> float:
        """How far the slow memory's `answer` stands out from its answers everywhere, in their
        standard deviations; by Parseval's theorem, without computing them."""
        everywhere = (self._anchor * spectrum).sum(axis=0)
        count = self._cells**2
        mean = float(everywhere[0, 0].real) / count
        ends = everywhere[:, :: self._cells // 2]  # all others stand for two frequencies
        total = 2.0 * float(np.vdot(everywhere, everywhere).real) - float(np.vdot(ends, ends).real)
        variance = total / count**2 - mean * mean
        outstanding: float = (answer - mean) / sqrt(max(variance, 1e-12))
        return outstanding

    def slow_answers(
        self, channels: Channels, offset: tuple[float, float], zooms: tuple[float, ...]
    ) -> list[float]:
        """The slow memory's answers at `offset` cells (x, y) off the middle if the window were
        each of `zooms` times as large; cells are interpolated instead of cutting it anew."""
        spread = self._spreads.get(zooms)
        if spread is None:
            spread = np.array([zoom * self._steps - self._at for zoom in zooms])
            self._spreads[zooms] = spread
        middle = 0.5 * (self._cells - 1)
        at = np.array([[[[middle + offset[0]]]], [[[middle + offset[1]]]]], np.float32)
        apart = at + spread
        np.abs(apart, out=apart)
        np.subtract(ONE, apart, out=apart)
        columns, rows = np.maximum(apart, NOTHING, out=apart)  # (zooms, cells, cells)
        flat = channels.reshape(-1, self._cells)
        answers = []
        for zoom, across, down in zip(zooms, columns, rows, strict=True):
            kernel = self._kernel if zoom == 1.0 else self._body_kernel
            narrow = (flat @ across.T).reshape(channels.shape)  # one product for all channels
            answers.append(float(np.vdot(kernel, down @ narrow)))
        return answers

    def _lesson(self, spectrum: Spectrum, offset: tuple[float, float]) -> tuple[Spectrum, Power]:
        label = self._label * self._fourier.shift(*offset)
        return label * np.conj(spectrum), _power(spectrum).sum(axis=0)

    def _refresh(self) -> None:
        self._filter = self._quick.blended(self._slow, ANCHOR).filter()
        self._anchor = self._slow.filter()
        turned = np.conj(self._anchor) * self._to_middle
        self._kernel = self._fourier.inverse(turned) * self._taper
        self._body_kernel = self._kernel * self._body


def _power(spectrum: Spectrum) -> Power:
    power: Power = np.square(spectrum.real) + np.square(spectrum.imag)
    return power
