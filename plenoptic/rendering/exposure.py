"""Exposure: the image, its error, the ground truth, the camera and the statistics of one render."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import KW_ONLY
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.files.reading import DEFAULT, FileLimits
from plenoptic.core.relative_error import ImageError, image_error
from plenoptic.core.values import Floats, Given, check_kind, file_path, frozen_array, seed_number, set_field, value
from plenoptic.errors import InvalidValueError
from plenoptic.rendering.crop import checked_region, region_text, samples_text
from plenoptic.rendering.exposure_metadata import checked_seed, possible
from plenoptic.rendering.settings import RenderSettings
from plenoptic.rendering.stats import RenderStats, StopReason
from plenoptic.truth.channels import GroundTruth, truth_names

if TYPE_CHECKING:
    import xarray

    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.optics.sensor.model import SensorModel
    from plenoptic.readout.raw import RawImage
    from plenoptic.viewer.page import Viewer

MOST_NAMES = 10_000
"""Objects of a scene whose names are kept: at most a megabyte in the head of a file."""


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
    seed : int or tuple of int, optional
        Of the random numbers; several where exposures of other seeds were merged, None where it is not known.
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
    seed: Given[int | tuple[int, ...] | None, int | Sequence[int] | None] = Given(default=None)
    camera: PlenopticCamera | None = None
    region: tuple[int, int, int, int] | None = None
    stats: RenderStats | None = None
    sample_counts: Given[NDArray[np.int32] | None, ArrayLike | None] = Given(default=None)
    settings: RenderSettings | None = None
    white: bool | None = None
    object_names: Given[tuple[str, ...] | None, Sequence[str] | None] = Given(default=None)

    def __post_init__(self) -> None:
        image = frozen_array(self.image, name="image", shape=("rows", "columns", "channels"), dtype=np.float32)
        if image.shape[2] not in (1, 3) or 0 in image.shape:
            raise InvalidValueError(f"image has shape {image.shape}; it must be (H, W, 1) or (H, W, 3), not empty")
        set_field(self, "image", image)
        for name, dtype, axes in (("standard_error", np.float32, 3), ("sample_counts", np.int32, 2)):
            if (given := getattr(self, name)) is not None:
                set_field(self, name, frozen_array(given, name=name, shape=image.shape[:axes], dtype=dtype))
        if self.truth is not None:
            check_kind(self.truth, "truth", GroundTruth, "pl.GroundTruth(depth=...)")
            if self.truth.shape != image.shape[:2]:
                has, must = (f"{shape[0]} x {shape[1]}" for shape in (self.truth.shape, image.shape))
                raise InvalidValueError(f"truth has {has} pixels; it must have the image's {must}")
        for name in ("samples", "replicates"):
            number = getattr(self, name)
            if number is not None:
                set_field(self, name, seed_number(number, name))
        if self.seed is not None:
            set_field(self, "seed", checked_seed(self.seed))
        counts = self.sample_counts
        if counts is not None and (counts.min() < 0 or (self.samples is not None and counts.max() > self.samples)):
            found = f"sample_counts go from {counts.min()} to {counts.max()}"
            raise InvalidValueError(f"{found}; they must be within 0 and samples, {self.samples}")
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
        return None if self._error is None else self._error.relative

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
        return None if self._error is None else self._error.rare

    @cached_property
    def _error(self) -> ImageError | None:
        """The error of the image, found when it is first asked for."""
        return None if self.standard_error is None else image_error(self.image, self.standard_error)

    @classmethod
    def merged(cls, parts: Iterable[Exposure]) -> Exposure:
        """One exposure of several: regions beside each other, and the same region with other seeds.

        Regions of a render of given samples have the bits of the whole. Exposures of the same region are weighed by
        their samples, and so are the squares of their errors; those with a single replicate each get their error from
        their differences, which is right on average over pixels and crude for each while they are few. What was merged
        knows all its seeds and can be merged with others; its means have been rounded once more then. An
        InvalidValueError where parts overlap, leave pixels out, share random numbers, or are of other cameras or
        settings. That they show the same scene is for the caller to know. `plenoptic merge` does the same for files,
        and for a store without having all in memory.

        Examples
        --------
        >>> import numpy as np, plenoptic as pl
        >>> halves = [pl.Exposure(np.ones((8, 8, 1)), samples=4, region=(0, 8, x, x + 8)) for x in (0, 8)]
        >>> pl.Exposure.merged(halves)
        Exposure(8 x 16 x 1, 4 samples per pixel, rows 0:8, columns 0:16)
        """
        from plenoptic.rendering.merging.merge import merged  # knows this class

        return merged(parts)

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
        """Write the exposure to a file, or for `.zarr` to a folder, in the format that the path's ending names.

        It appears whole or not at all.

        Parameters
        ----------
        path : path-like
            `.exr` keeps everything, as float32: ground truth is rounded from float64, and its whole
            numbers are exact up to 2^24. `.zarr` keeps every bit of everything, in a folder of many
            files that is opened a part at a time, and takes the place of one exposure only; it needs the
            package zarr. `.tif`, `.tiff` (linear) and `.png` (sRGB-encoded) keep
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
        from plenoptic.rendering import exposure_files, stores

        ending = exposure_files.checked_ending(path)
        if ending in (".exr", ".zarr"):
            if scale is not None:
                raise InvalidValueError(
                    f"scale is {scale:g}, but {ending} files keep the values as they are; leave it out"
                )
            (stores.save_store if ending == ".zarr" else exposure_files.save_exr)(self, path)
        else:
            exposure_files.save_16bit(self, path, scale, linear=ending != ".png")

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, limits: FileLimits = DEFAULT) -> Exposure:
        """Read an exposure that `save` wrote, or the image of any other file.

        A zarr store gives back the same exposure, and so does an EXR file, whose truth is float64 of float32 precision.
        Another image file gives the linear image, times its scale if it has one. A file from elsewhere gives what it
        holds. `limits` is as of `images.read_linear`; a store counts with all its files.

        Raises
        ------
        FileError
            Where the file is missing, damaged or no image, or its metadata cannot be understood.

        Examples
        --------
        See `save`.
        """
        from plenoptic.rendering import exposure_files, stores

        stored = file_path(path).suffix.lower() == ".zarr"
        with possible(path):
            return cls(**(stores.fields_of_store if stored else exposure_files.fields_of_image)(path, limits))

    def to_xarray(self) -> xarray.Dataset:
        """The same as an xarray dataset, with units and coordinates: rows and columns, mm on the sensor, channels.

        Nothing is copied: the arrays are the exposure's own, which cannot be written to. Of what `save` writes to
        `.zarr`, ``xarray.open_zarr(path)`` makes the same dataset, and reads only the parts that are used. Needs the
        package xarray.

        Examples
        --------
        >>> import numpy as np, plenoptic as pl
        >>> shot = pl.Exposure(np.ones((2, 3, 3)), truth=pl.GroundTruth(depth=np.full((2, 3), 400.0)))
        >>> data = shot.to_xarray()
        >>> dict(data.sizes), data.depth.units
        ({'row': 2, 'column': 3, 'channel': 3}, 'mm')
        >>> float(data.image.sel(row=1, column=2, channel="R"))
        1.0
        """
        from plenoptic.rendering.stores import dataset_of

        return dataset_of(self)

    def viewer(self, *, white: Exposure | None = None, region: tuple[slice, slice] | None = None) -> Viewer:
        """A page that is zoomed to single pixels and says all that is known of each, as notebooks show it.

        Parameters
        ----------
        white : Exposure, optional
            The white image of the camera: what is shown is divided by it, and so is radiance.
        region : (slice, slice), optional
            Rows and columns of the sensor, as ``np.s_[0:64, 0:64]``; None: all.

        Returns
        -------
        Viewer
            Notebooks show it, and `save(path)` writes it, as `save_html` does, which has an example.

        Raises
        ------
        InvalidValueError
            Where the region does not lie in the exposure, or the white image does not fit.

        Notes
        -----
        What the exposure lacks is not there: render with ``truth=pl.Truth.ALL`` for all of it. A click lights up all
        images of the point that a pixel shows, where there are a camera with microlenses and depth. Beyond 2^20 pixels
        blocks of them are averaged; docs/viewer.md says what is stored.
        """
        from plenoptic.viewer.raw import exposure_page  # knows this class

        return exposure_page(self, white=white, region=region)

    def save_html(
        self, path: str | os.PathLike[str], *, white: Exposure | None = None, region: tuple[slice, slice] | None = None
    ) -> None:
        """Write the page of `viewer`, which has the arguments, to one file, which any browser opens from the disk.

        A FileError where it cannot be written.

        Examples
        --------
        >>> import pathlib, tempfile, numpy as np, plenoptic as pl
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = pathlib.Path(folder) / "raw.html"
        ...     pl.Exposure(np.ones((2, 3, 1))).save_html(path)
        ...     path.stat().st_size < 1e5
        True
        """
        self.viewer(white=white, region=region).save(path)

    def __repr__(self) -> str:
        return f"Exposure({self._facts()})"

    def _facts(self) -> str:
        facts = [" x ".join(map(str, self.image.shape))]
        if self.interrupted:
            facts.append("interrupted")
        if (most := self.samples) is not None:
            counts = self.sample_counts
            facts.append(f"{most} sample{'s' * (most > 1)} per pixel" if counts is None else samples_text(counts))
        if not self.image.any():
            facts.append("black")
        elif (error := self.relative_error) is not None and error < np.inf:
            more = " or more: light is rare" if self.rare_light else ""
            facts.append(f"relative error {100 * error:.3g} %{more}")
        if self.truth is not None:
            facts.append(f"with {truth_names(self.truth.kinds)}")
        if self.region is not None:
            facts.append(region_text(self.region))
        if self.stats is not None:
            facts.append(f"{self.stats.seconds:.3g} s")
        return ", ".join(facts)

    def _repr_html_(self) -> str:
        """Image, a detail, error and truth, with one line of facts, for notebooks."""
        from plenoptic.plots.notebook.pictures import exposure_html

        return exposure_html(self)
