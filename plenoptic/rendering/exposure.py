"""Exposure: the image, its error, the ground truth, the camera and the statistics of one render."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic import __version__
from plenoptic.core.files.reading import DEFAULT, FileLimits
from plenoptic.core.files.serialization import describe, described_fields, restore, restored_fields
from plenoptic.core.relative_error import light_is_rare, relative_error
from plenoptic.core.values import (
    Floats,
    Given,
    check_kind,
    file_path,
    frozen_array,
    positive,
    seed_number,
    set_field,
    value,
    whole,
)
from plenoptic.errors import FileError, InvalidValueError
from plenoptic.rendering.settings import RenderSettings
from plenoptic.rendering.stats import RenderStats, StopReason
from plenoptic.truth.arrays import file_note, file_planes, truth_in
from plenoptic.truth.channels import GroundTruth, truth_names

if TYPE_CHECKING:
    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.optics.sensor.model import SensorModel
    from plenoptic.readout.raw import RawImage

_NAMES = {1: ("Y",), 3: ("R", "G", "B")}
_KEPT_AS_TEXT = ("samples", "replicates", "seed", "region", "camera", "stats", "settings", "white", "object_names")
MOST_NAMES = 10_000
"""Objects of a scene whose names are kept: at most a megabyte in the head of a file."""
_SAMPLES = "samples"


@value
class Exposure:
    """What one render gives: image, standard error, ground truth, camera and statistics.

    Parameters
    ----------
    image : (H, W, C) array_like
        Irradiance integral of radiance over a pixel's solid angle, averaged over its area, in scene
        units; linear; row 0 at the top; C is 1 or 3. Kept as float32.
    standard_error : (H, W, C) array_like, optional
        One standard deviation of `image`'s Monte Carlo error. Kept as float32.
    truth : GroundTruth, optional
        What the pixels show: depth, normals, objects, ...
    samples : int, optional
        Paths per pixel; None where it is not known.
    replicates : int, optional
        Independent scramblings from which the standard error was found; None where it is not known.
    seed : int, optional
        Of the random numbers; None where it is not known.
    camera : PlenopticCamera, optional
        The camera that took it.
    region : (int, int, int, int), optional
        First row, end row, first column, end column on the sensor; None: the whole sensor.
    stats : RenderStats, optional
        What it took.
    sample_counts : (H, W) array_like of int, optional
        Paths of each pixel; None where all have `samples`, which is otherwise the most that a pixel has.
    settings : RenderSettings, optional
        How it was rendered: what `replay` needs to know.
    white : bool, optional
        Whether `render_white` made it; None where it is not known.
    object_names : sequence of str, optional
        The name of each number in `truth.object`, as `Scene.object_names` has them, the last one '' for -1:
        ``np.array(shot.object_names)[shot.truth.object]`` names what each pixel shows. None where the objects of pixels
        were not asked for, or the scene has more than 10 000.

    Raises
    ------
    InvalidValueError
        Where a shape does not fit the image's, or a count is impossible.

    Examples
    --------
    >>> import numpy as np, plenoptic as pl
    >>> shot = pl.Exposure(np.ones((2, 3, 1)), standard_error=np.full((2, 3, 1), 0.01), samples=64)
    >>> shot
    Exposure(2 x 3 x 1, 64 samples per pixel, relative error 1 %)
    """

    image: Given[NDArray[np.float32], ArrayLike]
    _: KW_ONLY
    standard_error: Given[NDArray[np.float32] | None, ArrayLike | None] = Given(default=None)
    truth: GroundTruth | None = None
    samples: int | None = None
    replicates: int | None = None
    seed: int | None = None
    camera: PlenopticCamera | None = None
    region: tuple[int, int, int, int] | None = None
    stats: RenderStats | None = None
    sample_counts: Given[NDArray[np.int32] | None, ArrayLike | None] = Given(default=None)
    settings: RenderSettings | None = None
    white: bool | None = None
    object_names: Given[tuple[str, ...] | None, Sequence[str] | None] = Given(default=None)

    def __post_init__(self) -> None:
        image = frozen_array(self.image, name="image", shape=("rows", "columns", "channels"), dtype=np.float32)
        if image.shape[2] not in _NAMES or 0 in image.shape:
            raise InvalidValueError(f"image has shape {image.shape}; it must be (H, W, 1) or (H, W, 3), not empty")
        set_field(self, "image", image)
        for name, dtype, axes in (("standard_error", np.float32, 3), ("sample_counts", np.int32, 2)):
            if (given := getattr(self, name)) is not None:
                set_field(self, name, frozen_array(given, name=name, shape=image.shape[:axes], dtype=dtype))
        if self.truth is not None:
            check_kind(self.truth, "truth", GroundTruth, "pl.GroundTruth(depth=...)")
            if self.truth.shape != image.shape[:2]:
                raise InvalidValueError(
                    f"truth has {self.truth.shape[0]} x {self.truth.shape[1]} pixels; "
                    f"it must have the image's {image.shape[0]} x {image.shape[1]}"
                )
        for name in ("samples", "replicates", "seed"):
            number = getattr(self, name)
            if number is not None:
                set_field(self, name, seed_number(number, name))
        counts = self.sample_counts
        if counts is not None and (counts.min() < 0 or (self.samples is not None and counts.max() > self.samples)):
            raise InvalidValueError(
                f"sample_counts go from {counts.min()} to {counts.max()}; they must be within 0 and samples, "
                f"{self.samples}"
            )
        if self.region is not None:
            set_field(self, "region", checked_region(self.region, image.shape[:2]))
        for name, kind in (("stats", RenderStats), ("settings", RenderSettings)):
            if getattr(self, name) is not None:
                check_kind(getattr(self, name), name, kind, f"the `{name}` of another exposure")
        if self.white is not None:
            check_kind(self.white, "white", bool, "True")
        if (names := self.object_names) is not None:
            if not isinstance(names, tuple | list) or not all(isinstance(name, str) for name in names):
                raise InvalidValueError(f"object_names is {names!r}; it must be texts, one for each object")
            set_field(self, "object_names", tuple(names))

    @property
    def depth(self) -> Floats | None:
        """(H, W): -z in the camera's frame in mm, inf where nothing is met; None where it was not asked for."""
        return None if self.truth is None else self.truth.depth

    @property
    def interrupted(self) -> bool:
        """Whether Ctrl-C came while it was rendered; in its last moment all may have been done."""
        return self.stats is not None and self.stats.stopped_by is StopReason.INTERRUPTED

    @property
    def relative_error(self) -> float | None:
        """The root mean square, over lit pixels, of the standard error over the value; None without standard error.

        Errors and values are those of the channels together: root mean square and mean, the latter drawn towards that
        of neighbours as far as it is noisy. Lit are the pixels above a tenth of the 99th percentile, see `lit_pixels`.
        nan for an image without light or error, inf for one that has error only, or pixels without samples. With
        `rare_light` it may be far too small.
        """
        return None if self.standard_error is None else relative_error(self.image, self.standard_error)

    @property
    def rare_light(self) -> bool | None:
        """Whether `relative_error` cannot be known: some pixels are the only ones to have met rare light.

        Fewer than 8 pixels, and than a 16th of the lit ones, carry the error; or they are so bright that others look
        dark: without the standard errors, pixels of 1/2.5 of the brightness would be lit. None without standard error.

        Examples
        --------
        >>> import numpy as np, plenoptic as pl
        >>> error = np.full((32, 32, 1), 0.02)
        >>> pl.Exposure(np.ones((32, 32, 1)), standard_error=error).rare_light
        False
        >>> error[9, 7] = 3.0
        >>> pl.Exposure(np.ones((32, 32, 1)), standard_error=error).rare_light
        True
        """
        return None if self.standard_error is None else light_is_rare(self.image, self.standard_error)

    def develop(self, sensor: SensorModel, *, seed: int = 0) -> RawImage:
        """What a sensor reads out when exposed to this image: electrons, noise and digital numbers.

        Light transport is over here: one render serves many sensors, exposure times and seeds. The Monte Carlo error
        of the image is no noise of the sensor and adds to it; render until it is well below the shot noise.

        Parameters
        ----------
        sensor : SensorModel
            Exposure time, gain, colour filters, noise, full well, bits; each effect can be absent.
        seed : int
            Of shot and read noise, at least 0; the same seed gives the same bits.

        Examples
        --------
        >>> import numpy as np, plenoptic as pl
        >>> flat = pl.Exposure(np.full((4, 4, 1), 0.5))
        >>> sensor = pl.SensorModel(photon_rate=2000.0, exposure_time=1.0, quantum_efficiency=0.5, gain=1.0, bits=12)
        >>> raw = flat.develop(sensor, seed=1)
        >>> raw.data.dtype, bool(abs(raw.electrons().mean() - 500.0) < 30.0)
        (dtype('uint16'), True)
        """
        from plenoptic.readout.develop import develop  # knows this class

        return develop(self, sensor, seed=seed)

    def save(self, path: str | os.PathLike[str], *, scale: float | None = None) -> None:
        """Write the exposure to a file, in the format that the path's ending names.

        The file appears whole or not at all.

        Parameters
        ----------
        path : path-like
            `.exr` keeps everything, as float32: ground truth is rounded from float64, and its whole
            numbers are exact up to 2^24. `.tif`, `.tiff` (linear) and `.png` (sRGB-encoded) keep
            the image in 16 bits, with the scale, samples, seed and region, and neither error, truth,
            camera nor statistics.
        scale : float, optional
            For 16 bits: the value in the image that becomes 65535, by default the image's maximum.
            Values above it are cut, and so are negative ones.

        Raises
        ------
        FileError
            Where the file cannot be written or the ending is unknown.
        InvalidValueError
            Where the scale is not above 0, or the camera is made of things that cannot be described.

        Examples
        --------
        >>> import pathlib, tempfile, numpy as np, plenoptic as pl
        >>> shot = pl.Exposure(np.ones((2, 3, 1)), samples=64, seed=0)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = pathlib.Path(folder) / "shot.exr"
        ...     shot.save(path)
        ...     pl.Exposure.load(path) == shot
        True
        """
        from plenoptic.core.files import images

        ending = file_path(path).suffix.lower()
        if ending == ".exr":
            if scale is not None:
                raise InvalidValueError(f"scale is {scale:g}, but EXR files keep the values as they are; leave it out")
            images.write_channels(path, self._channels(), self._texts(_KEPT_AS_TEXT))
        elif ending in (".tif", ".tiff", ".png"):
            self._save_16bit(path, images.SRGB if ending == ".png" else images.LINEAR, scale)
        else:
            raise FileError(f"{os.fspath(path)!r} ends in {ending!r}; it must end in .exr, .tif, .tiff or .png")

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, limits: FileLimits = DEFAULT) -> Exposure:
        """Read an exposure that `save` wrote, or the image of any other file.

        An EXR file gives back everything; truth returns as float64 of float32 precision. Another image file gives the
        linear image, times its scale if it has one. A file from elsewhere gives what it holds. `limits` is as of
        `images.read_linear`.

        Raises
        ------
        FileError
            Where the file is missing, damaged or no image, or its metadata cannot be understood.

        Examples
        --------
        See `save`.
        """
        from plenoptic.core.files import images

        image, channels, metadata = images.read_picture(path, limits=limits)
        kept = restored_fields(metadata, _KEPT_AS_TEXT)
        planes = [channels.get(f"error.{name}") for name in _NAMES[image.shape[2]]]
        errors = [plane for plane in planes if plane is not None]
        try:
            if "plenoptic:scale" in metadata:
                image = image * np.float32(positive(restore(metadata["plenoptic:scale"]), "scale"))
            return cls(
                image,
                standard_error=np.stack(errors, axis=-1) if len(errors) == len(planes) else None,
                truth=truth_in(channels),
                sample_counts=_counts_in(channels.get(_SAMPLES), kept.get("samples")),
                **kept,
            )
        except InvalidValueError as error:
            raise FileError(f"{os.fspath(path)!r} holds no possible exposure: {error}") from error

    def _channels(self) -> Mapping[str, NDArray[Any]]:
        names = _NAMES[self.image.shape[2]]
        channels: dict[str, NDArray[Any]] = {name: self.image[:, :, i] for i, name in enumerate(names)}
        if self.standard_error is not None:
            channels |= {f"error.{name}": self.standard_error[:, :, i] for i, name in enumerate(names)}
        if self.sample_counts is not None:
            channels[_SAMPLES] = self.sample_counts.astype(np.float32)
        if self.truth is not None:
            channels |= file_planes(self.truth)
        return channels

    def _texts(self, names: tuple[str, ...]) -> dict[str, str]:
        texts = {"Software": f"plenoptic {__version__}"}
        texts |= described_fields(self, names)
        if "camera" in names and self.truth is not None:
            texts["plenoptic:note"] = file_note(self.truth)
        return texts

    def _save_16bit(self, path: str | os.PathLike[str], encoding: str, scale: float | None) -> None:
        from plenoptic.core.files import images
        from plenoptic.core.files.codes import brightest, codes

        scale = positive(brightest(self.image) if scale is None else scale, "scale")
        texts = self._texts(("samples", "replicates", "seed", "region"))
        texts |= {"plenoptic:scale": describe(scale), images.COLOR_SPACE: encoding}
        images.write_16bit(path, codes(self.image, scale=scale, encoded=encoding == images.SRGB), texts)

    def __repr__(self) -> str:
        return f"Exposure({self._facts()})"

    def _facts(self) -> str:
        facts = [" x ".join(map(str, self.image.shape))]
        if self.interrupted:
            facts.append("interrupted")
        if self.samples is not None:
            counts = self.sample_counts
            facts.append(f"{self.samples} samples per pixel" if counts is None else samples_text(counts))
        if not self.image.any():
            facts.append("black")
        elif self.relative_error is not None and self.relative_error < np.inf:
            more = " or more: light is rare" if self.rare_light else ""
            facts.append(f"relative error {100 * self.relative_error:.3g} %{more}")
        if self.truth is not None:
            facts.append(f"with {truth_names(self.truth.kinds)}")
        if self.region is not None:
            facts.append(region_text(self.region))
        if self.stats is not None:
            facts.append(f"{self.stats.seconds:.3g} s")
        return ", ".join(facts)

    def _repr_html_(self) -> str:
        """The picture, its brightest 0.1 % cut, with one line of facts, for notebooks."""
        from plenoptic.core.files.preview import html_figure

        return html_figure(self.image, self._facts())


def _counts_in(plane: NDArray[Any] | None, samples: Any) -> NDArray[Any] | None:
    """Counts of samples of a file, which are rounded beyond 2^24."""
    return plane if plane is None or not isinstance(samples, int) else np.minimum(plane.astype(np.float64), samples)


def samples_text(counts: NDArray[Any]) -> str:
    """How much of the frame has what: 64 samples in 40 % of the pixels, 8 to 56 in 35 %, none in 25 %."""
    most, between = int(counts.max()), counts[(counts > 0) & (counts < counts.max())]
    parts = [f"{most or 'no'} samples in {100 * np.mean(counts == most):.3g} % of the pixels"]
    if between.size:
        low, high = int(between.min()), int(between.max())
        parts.append(f"{low} to {high}" if low < high else f"{low}")
        parts[-1] += f" in {100 * between.size / counts.size:.3g} %"
    if most and not counts.all():
        parts.append(f"none in {100 * np.mean(counts == 0):.3g} %")
    return ", ".join(parts)


def region_text(region: tuple[int, int, int, int]) -> str:
    """For a line of facts: rows 0:4, columns 2:6."""
    first_row, end_row, first_column, end_column = region
    return f"rows {first_row}:{end_row}, columns {first_column}:{end_column}"


def checked_region(region: tuple[int, ...], shape: tuple[int, ...]) -> tuple[int, ...]:
    """First row, end row, first column and end column of an image of this shape, or an error."""
    if not isinstance(region, tuple | list) or len(region) != 4:
        raise InvalidValueError(f"region is {region!r}; it must be (first row, end row, first column, end column)")
    checked = tuple(whole(number, "region", at_least=0) for number in region)
    first_row, end_row, first_column, end_column = checked
    if (end_row - first_row, end_column - first_column) != shape:
        raise InvalidValueError(
            f"region {checked} has {end_row - first_row} x {end_column - first_column} pixels; "
            f"it must have the image's {shape[0]} x {shape[1]}"
        )
    return checked
