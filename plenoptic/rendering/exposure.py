"""Exposure: image, standard error, ground truth, camera and statistics of one render."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import KW_ONLY
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.core.display import picture_of
from plenoptic.core.files.file_limits import DEFAULT, FileLimits, content_errors
from plenoptic.core.relative_error import ImageError, image_error
from plenoptic.core.values import Floats, Given, check_kind, file_path, frozen_array, seed_number, set_field, value
from plenoptic.errors import InvalidValueError
from plenoptic.rendering.crop import checked_region, samples_text
from plenoptic.rendering.exposure_metadata import checked_seed, metadata_of
from plenoptic.rendering.settings import RenderSettings
from plenoptic.rendering.stats import RenderStats, StopReason
from plenoptic.truth.channels import GroundTruth

if TYPE_CHECKING:
    import xarray

    from plenoptic.camera.camera import PlenopticCamera
    from plenoptic.optics.sensor.model import SensorModel
    from plenoptic.readout.raw import RawImage
    from plenoptic.viewer.page import Viewer

MOST_NAMES = 10_000
"""Maximum number of object names in an exposure: at most a megabyte of metadata."""


@value
class Exposure:
    """Result of one render: image, standard error, ground truth, camera and statistics.

    Parameters
    ----------
    image : (H, W, C) array_like
        Irradiance integral of radiance over a pixel's solid angle, averaged over its area, in scene
        units; linear; row 0 at the top; C is 1 or 3. Kept as float32.
    standard_error : (H, W, C) array_like, optional
        One standard deviation of `image`'s Monte Carlo error. Kept as float32.
    truth : GroundTruth, optional
        Ground truth of the pixels: depth, normals, objects, ...
    samples : int, optional
        Paths per pixel; None if unknown.
    replicates : int, optional
        Independent scramblings from which the standard error was estimated; None if unknown.
    seed : int or tuple of int, optional
        Seed of the random numbers; several for merged exposures, None if unknown.
    camera : PlenopticCamera, optional
        The camera of the exposure.
    region : (int, int, int, int), optional
        First row, end row, first column, end column on the sensor; None: the whole sensor.
    stats : RenderStats, optional
        Time, paths and losses of the render.
    sample_counts : (H, W) array_like of int, optional
        Paths of each pixel; None if all have `samples`, which is otherwise the maximum over the pixels.
    settings : RenderSettings, optional
        Settings of the render, which `replay` needs.
    white : bool, optional
        True for a white image of `render_white`; None if unknown.
    object_names : sequence of str, optional
        Name of each number in `truth.object`, as in `Scene.object_names`, the last one '' for -1:
        ``np.array(shot.object_names)[shot.truth.object]`` names the object of each pixel. None if objects were not
        requested, or the scene has more than 10 000.

    Raises
    ------
    InvalidValueError
        If a shape does not fit the image's, or a count is impossible.

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
            if (array := getattr(self, name)) is not None:
                set_field(self, name, frozen_array(array, name=name, shape=image.shape[:axes], dtype=dtype))
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
            counts_text = f"sample_counts go from {counts.min()} to {counts.max()}"
            raise InvalidValueError(f"{counts_text}; they must be within 0 and samples, {self.samples}")
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
        """(H, W): -z in the camera's frame in mm, inf where rays hit nothing; None if not requested."""
        return None if self.truth is None else self.truth.depth

    @property
    def interrupted(self) -> bool:
        """True if the render was interrupted by Ctrl-C, possibly in its last moment, when all was done."""
        return self.stats is not None and self.stats.stopped_by is StopReason.INTERRUPTED

    @property
    def relative_error(self) -> float | None:
        """Root mean square, over lit pixels, of the standard error over the value; None without standard error.

        Errors and values are averaged over the channels: root mean square and mean. The mean is shrunk towards that of
        the neighbours according to its noise. Lit pixels are above a tenth of the 99th percentile, see `lit_pixels`.
        nan for an image without light or error, inf for one with error only, or with pixels without samples. With
        `rare_light` it may be far too small.
        """
        return None if self._error is None else self._error.relative

    @property
    def rare_light(self) -> bool | None:
        """True if `relative_error` is unreliable, because only few pixels have sampled rare light.

        Fewer than 8 pixels, and fewer than a 16th of the lit ones, carry the error; or they are so bright that others
        count as unlit: without one standard error of each pixel, the threshold of lit pixels would fall below 1/2.5 of
        its value. Or caustics that no path may have met exceed it (`RenderStats.unmet_light`), or fewer than 8 pixels
        carry it in their presence. None without standard error.

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
        unmet = 0.0 if self.stats is None else self.stats.unmet_light
        return None if self._error is None else self._error.rare or self._error.misses(unmet)

    @cached_property
    def _error(self) -> ImageError | None:
        """Error of the image, computed on first use."""
        return None if self.standard_error is None else image_error(self.image, self.standard_error)

    @classmethod
    def merged(cls, parts: Iterable[Exposure]) -> Exposure:
        """Merge exposures: adjacent regions, and the same region with different seeds.

        Regions of a render with given samples have the same bits as the whole. Exposures of the same region are
        weighted by their samples, and so are their squared errors. Exposures with a single replicate each get an error
        from their differences, which is unbiased on average over pixels, and crude for single pixels of few exposures.
        A merged exposure stores all its seeds and can be merged again; its means are then rounded once more. Raises
        InvalidValueError if parts overlap, leave pixels out, share random numbers, or differ in camera or settings.
        The caller must ensure that they show the same scene. `plenoptic merge` does the same for files, and for a
        store without keeping all in memory.

        Examples
        --------
        >>> import numpy as np, plenoptic as pl
        >>> halves = [pl.Exposure(np.ones((8, 8, 1)), samples=4, region=(0, 8, x, x + 8)) for x in (0, 8)]
        >>> pl.Exposure.merged(halves)
        Exposure(8 x 16 x 1, 4 samples per pixel, rows 0:8, columns 0:16)
        """
        from plenoptic.rendering.merging.merge import merge_exposures  # knows this class

        return merge_exposures(parts)

    def develop(self, sensor: SensorModel, *, seed: int = 0) -> RawImage:
        """Simulate the read-out of a sensor exposed to this image: electrons, noise and digital numbers.

        Light transport is finished: one render serves many sensors, exposure times and seeds. The Monte Carlo error of
        the image adds to the noise of the sensor; render until it is well below the shot noise.

        Parameters
        ----------
        sensor : SensorModel
            Exposure time, gain, colour filters, noise, full well, bits; each effect can be absent.
        seed : int
            Seed of shot and read noise, at least 0; the same seed gives the same bits.

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
        """Write the exposure to a file, or for `.zarr` to a folder, in the format of the path's suffix.

        The file is written atomically.

        Parameters
        ----------
        path : path-like
            `.exr` stores everything, as float32: ground truth is rounded from float64, and its integers are exact up to
            2^24. `.zarr` stores everything without loss, in a folder of many files of which parts can be read. It
            replaces an existing store only if that contains one exposure, and needs the package zarr. `.tif`, `.tiff`
            (linear) and `.png` (sRGB-encoded) keep the image in 16 bits, with the scale, samples, seed and region, and
            neither error, truth, camera nor statistics.
        scale : float, optional
            For 16 bits: the value of the image that becomes 65535, by default the image's maximum. Larger and negative
            values are clipped.

        Raises
        ------
        FileError
            If the file cannot be written or the suffix is unknown.
        InvalidValueError
            If the scale is not above 0, or the camera contains values that cannot be described.

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
        from plenoptic.rendering import exposure_files

        ending = exposure_files.checked_ending(path)
        if ending in (".exr", ".zarr"):
            if scale is not None:
                raise InvalidValueError(
                    f"scale is {scale!r:.40}, but {ending} files keep the values as they are; leave it out"
                )
            (exposure_files.save_store if ending == ".zarr" else exposure_files.save_exr)(self, path)
        else:
            exposure_files.save_16bit(self, path, scale, linear=ending != ".png")

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, limits: FileLimits = DEFAULT) -> Exposure:
        """Read an exposure that `save` wrote, or the image of any other file.

        A zarr store restores the same exposure, and so does an EXR file, with truth of float32 precision in float64.
        Another image file gives the linear image, times its scale if it has one. `limits` is as in
        `images.read_linear`; for a store, all its files count together.

        Raises
        ------
        FileError
            If the file is missing, damaged or no image, or its metadata is malformed.

        Examples
        --------
        See `save`.
        """
        from plenoptic.rendering import exposure_files

        stored = file_path(path).suffix.lower() == ".zarr"
        with content_errors(os.fspath(path), "holds no possible exposure"):
            return cls(**(exposure_files.fields_of_store if stored else exposure_files.fields_of_image)(path, limits))

    def to_xarray(self) -> xarray.Dataset:
        """The exposure as an xarray dataset, with units and coordinates: rows and columns, mm on the sensor, channels.

        Nothing is copied: the arrays are the exposure's own, which are read-only. ``xarray.open_zarr(path)`` opens the
        same dataset from a `.zarr` folder written by `save`, and reads only the parts that are used. Needs the package
        xarray.

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
        from plenoptic.rendering.exposure_files import dataset_of

        return dataset_of(self)

    def viewer(self, *, white: Exposure | None = None, region: tuple[slice, slice] | None = None) -> Viewer:
        """Interactive page that zooms to single pixels and displays all data of each, shown by notebooks.

        Parameters
        ----------
        white : Exposure, optional
            White image of the camera, by which the displayed image is divided to give radiance.
        region : (slice, slice), optional
            Rows and columns of the sensor, as ``np.s_[0:64, 0:64]``; None: all.

        Returns
        -------
        Viewer
            Notebooks display it; `save(path)` writes it. For an example, see `save_html`.

        Raises
        ------
        InvalidValueError
            If the region does not lie in the exposure, or the white image does not fit.

        Notes
        -----
        Render with ``truth=pl.Truth.ALL`` for the complete page. If there are a camera with microlenses and depth, a
        click highlights all images of the point that a pixel shows. Beyond 2^20 pixels, blocks are averaged; for the
        stored data see docs/viewer.md.
        """
        from plenoptic.viewer.raw import exposure_page  # knows this class

        return exposure_page(self, white=white, region=region)

    def save_html(
        self, path: str | os.PathLike[str], *, white: Exposure | None = None, region: tuple[slice, slice] | None = None
    ) -> None:
        """Write the page of `viewer` to one file, which any browser opens from the disk.

        Raises FileError if the file cannot be written.

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
        counts, quality = self.sample_counts, "" if self.image.any() else "black"
        if not quality and (error := self.relative_error) is not None and error < np.inf:
            quality = f"relative error {100 * error:.3g} %{' or more: light is rare' if self.rare_light else ''}"
        return metadata_of(self).summary(
            "" if counts is None or self.samples is None else samples_text(counts), quality
        )

    _repr_html_ = picture_of
