"""RawImage: the numbers that a sensor reads out, and the way back to light."""

from __future__ import annotations

import os
from dataclasses import KW_ONLY
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.display import picture_of
from plenoptic.core.files import images
from plenoptic.core.files.codes import COLOR_SPACE, whole_numbers
from plenoptic.core.files.file_limits import DEFAULT, FileLimits
from plenoptic.core.files.serialization import fields_from_metadata, fields_to_metadata
from plenoptic.core.values import (
    Floats,
    Given,
    check_kind,
    file_path,
    numbers,
    plain_array,
    seed_number,
    set_field,
    value,
    whole,
)
from plenoptic.errors import FileError, InvalidValueError
from plenoptic.optics.sensor.color_filter import BayerPattern, Filters, channels_of
from plenoptic.optics.sensor.demosaic import DemosaicMethod, demosaic
from plenoptic.optics.sensor.model import SensorModel
from plenoptic.rendering.crop import checked_region, region_text
from plenoptic.rendering.exposure import Exposure

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera


_KEPT_AS_TEXT = ("model", "region", "seed", "samples")


@value
class RawImage:
    """Raw image of a sensor: one number for each pixel, or three for a sensor of three layers.

    Parameters
    ----------
    data : (H, W) or (H, W, 3) array_like
        Digital numbers (DN), row 0 at the top; stored as uint16, or as float64 if the model has no quantisation.
    model : SensorModel
        The sensor.
    region : (int, int, int, int), optional
        First row, end row, first column, end column on the sensor; None: the whole sensor.
    seed : int, optional
        Seed of shot, read and row noise.
    samples : int, optional
        Paths per pixel of the exposure, whose Monte Carlo error the data contain.
    camera : PlenopticCamera, optional
        The camera that took the exposure.

    Raises
    ------
    InvalidValueError
        If shape or numbers cannot be those of the sensor.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> sensor = pl.SensorModel(photon_rate=3000.0, black_level=64, colour_filters=pl.BayerPattern.RGGB)
    >>> raw = pl.Exposure(np.ones((4, 6, 3))).develop(sensor)
    >>> raw.data.shape, raw.data.dtype, raw.black_level, raw.white_level
    ((4, 6), dtype('uint16'), 64.0, 4095.0)
    >>> raw.demosaic(pl.DemosaicMethod.MHC)
    Exposure(4 x 6 x 3)
    """

    data: Given[NDArray[Any], ArrayLike]
    model: SensorModel
    _: KW_ONLY
    region: tuple[int, int, int, int] | None = None
    seed: int | None = None
    samples: int | None = None
    camera: PlenopticCamera | None = None

    def __post_init__(self) -> None:
        check_kind(self.model, "model", SensorModel, "pl.SensorModel(photon_rate=1e6)")
        set_field(self, "data", _checked_data(self.data, self.model))
        if self.region is not None:
            set_field(self, "region", checked_region(self.region, self.data.shape[:2]))
        if self.seed is not None:
            set_field(self, "seed", seed_number(self.seed))
        if self.samples is not None:
            set_field(self, "samples", whole(self.samples, "samples", at_least=0))

    @property
    def black_level(self) -> float:
        """DN without light."""
        return self.model.black_level

    @property
    def white_level(self) -> float:
        """DN of a saturated pixel; if the full well limits it, later noise scatters around it."""
        return self.model.white_level

    @property
    def colour_filters(self) -> Filters | None:
        """Filters of the sensor, whose period begins at row 0 and column 0 of the sensor, not of the region."""
        return self.model.colour_filters

    @property
    def channels(self) -> NDArray[np.int64] | None:
        """(H, W): the channel that each pixel sees, 0 red, 1 green, 2 blue; None without filters."""
        if self.model.colour_filters is None:
            return None
        rows, columns = self.data.shape[:2]
        return channels_of(self.model.colour_filters, (rows, columns), self._first)

    @property
    def fraction_saturated(self) -> float:
        """Fraction of the numbers that reach the white level."""
        return float(np.mean(self.data >= self.white_level))

    @property
    def _first(self) -> tuple[int, int]:
        return (0, 0) if self.region is None else (self.region[0], self.region[2])

    def electrons(self) -> Floats:
        """Electrons, shaped as `data`: (DN - black level) / gain, with dark current; noise makes some negative.

        Examples
        --------
        >>> import plenoptic as pl
        >>> pl.sensor.RawImage([[100, 300]], pl.SensorModel(photon_rate=1.0, gain=0.5, black_level=100)).electrons()
        array([[  0., 400.]])
        """
        return np.asarray((self.data.astype(np.float64) - self.model.black_level) / self.model.gain)

    def linear(self) -> Floats:
        """Radiance, shaped as `data`: electrons less the mean dark current, over those of an image of 1.

        Fixed pattern, noise and saturation remain. Every channel is divided by its own rate and quantum efficiency, so
        that equal channels of an exposure are equal again.

        Examples
        --------
        >>> import plenoptic as pl
        >>> pl.sensor.RawImage([[100, 300]], pl.SensorModel(photon_rate=800.0, gain=0.5, black_level=100)).linear()
        array([[0. , 0.5]])
        """
        per_unit, channel = self.model.electrons_per_unit, self.channels
        if channel is not None:
            per_unit = np.broadcast_to(per_unit, 3)[channel]
        return np.asarray((self.electrons() - self.model.dark_electrons) / per_unit)

    def demosaic(
        self, method: DemosaicMethod = DemosaicMethod.LINEAR, *, white_balance: tuple[float, float, float] | None = None
    ) -> Exposure:
        """All channels at all pixels, in the units of the exposure, with the artefacts of interpolation.

        Parameters
        ----------
        method : DemosaicMethod
            LINEAR and MHC interpolate Bayer patterns; WEIGHTED_MEAN any pattern.
        white_balance : 3 floats, optional
            Factors for red, green and blue, applied before interpolation. None: none, which leaves a scene
            of equal channels grey, see `linear`.

        Returns
        -------
        Exposure
            (H, W, 3), without standard error; (H, W, C) as it is for a sensor without colour filters.

        Raises
        ------
        InvalidValueError
            If the method does not support the pattern, a channel has no pixel, or the image is too small.
        """
        linear, filters = self.linear(), self.model.colour_filters
        factors = np.ones(3) if white_balance is None else _factors(white_balance)
        picture: NDArray[np.floating[Any]] = linear.reshape(*linear.shape[:2], -1)
        if filters is not None:
            picture = demosaic(linear * factors[self.channels], filters, self._first, method)
        elif white_balance is not None:
            picture = picture * factors
        return Exposure(picture, samples=self.samples, seed=self.seed, camera=self.camera, region=self.region)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the numbers to a 16-bit file, whole or not at all, with sensor model, region, seed and samples.

        The camera is not stored.

        Parameters
        ----------
        path : path-like
            Must end in `.tif`, `.tiff` or `.png`; its folder must exist.

        Raises
        ------
        FileError
            If the file cannot be written.
        InvalidValueError
            If the numbers are not whole, since the model has no quantisation.

        Examples
        --------
        >>> import pathlib, tempfile, plenoptic as pl
        >>> raw = pl.sensor.RawImage([[100, 300]], pl.SensorModel(photon_rate=1.0))
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = pathlib.Path(folder) / "raw.tif"
        ...     raw.save(path)
        ...     pl.sensor.RawImage.load(path) == raw
        True
        """
        if self.model.bits is None:
            raise InvalidValueError("the numbers are not quantised, so no 16-bit file holds them; give the model bits")
        texts = fields_to_metadata(self, _KEPT_AS_TEXT)
        pixels = self.data.reshape(*self.data.shape[:2], -1)
        images.write_16bit(path, pixels, {"plenoptic:kind": "raw", COLOR_SPACE: images.LINEAR, **texts})

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, limits: FileLimits = DEFAULT) -> RawImage:
        """Read a raw image that `save` wrote.

        Parameters
        ----------
        path : path-like
        limits : FileLimits
            The size of the file, and of the image.

        Raises
        ------
        FileError
            If the file is missing, damaged or no raw image of this package.
        """
        channels, metadata = images.read_channels(file_path(path), limits=limits)
        if "plenoptic:model" not in metadata:
            raise FileError(f"{os.fspath(path)!r} names no sensor model; read it with pl.images.read_raw")
        metadata_fields = fields_from_metadata(metadata, _KEPT_AS_TEXT)
        data = whole_numbers(channels.values(), 16)
        try:
            return cls(data[:, :, 0] if data.shape[2] == 1 else data, **metadata_fields)
        except (InvalidValueError, TypeError) as error:
            raise FileError(f"{os.fspath(path)!r} holds no possible raw image: {error}") from error

    def __repr__(self) -> str:
        facts, filters = [" x ".join(map(str, self.data.shape))], self.model.colour_filters
        if isinstance(filters, BayerPattern):
            facts.append(filters.name)
        elif filters is not None:
            facts.append("{} x {} filters".format(*filters.shape))
        facts.append("not quantised" if self.model.bits is None else f"{self.model.bits} bits")
        facts.append(f"{100 * self.fraction_saturated:.3g} % saturated")
        if self.region is not None:
            facts.append(region_text(self.region))
        return f"RawImage({', '.join(facts)})"

    _repr_html_ = picture_of


def _checked_data(values: Any, model: SensorModel) -> NDArray[Any]:
    data = plain_array(values, "data").copy()
    if data.ndim not in (2, 3) or data.size == 0 or data.shape[2:] not in ((), (3,)) or data.dtype.kind not in "iuf":
        raise InvalidValueError(
            f"data has shape {data.shape} and type {data.dtype}; it must be numbers (H, W) or (H, W, 3), not empty"
        )
    if data.ndim == 3 and model.colour_filters is not None:
        raise InvalidValueError(f"data has shape {data.shape}; behind colour filters it must be (H, W)")
    if model.bits is not None:
        largest = 2**model.bits - 1
        if not ((data >= 0) & (data <= largest) & (data == np.rint(data))).all():
            raise InvalidValueError(f"data must be whole numbers from 0 to {largest}, those of {model.bits} bits")
    data = data.astype(np.float64 if model.bits is None else np.uint16)
    data.flags.writeable = False
    return data


def _factors(white_balance: Any) -> Floats:
    factors = numbers(white_balance, "white_balance")
    if factors.shape != (3,) or not (np.isfinite(factors) & (factors > 0)).all():
        raise InvalidValueError(f"white_balance is {white_balance!r}; it must be three finite factors above 0")
    return factors
