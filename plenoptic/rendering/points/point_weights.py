"""Weights of particles in pixels: ground truth of an image of particles, which is their product with intensities."""

from __future__ import annotations

import io
import os
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.camera.psf.point_spread import check_focusing
from plenoptic.camera.psf.psf_results import centroids
from plenoptic.core.files.array_files import read_npz, write_npz
from plenoptic.core.files.atomic_file import write_file
from plenoptic.core.files.extras import extra_package
from plenoptic.core.files.file_limits import DEFAULT, FileLimits, content_errors, read_file
from plenoptic.core.parallel import thread_count
from plenoptic.core.progress.bar import CallProgress
from plenoptic.core.values import (
    Floats,
    check_kind,
    checked_shape,
    contiguous,
    file_path,
    numbers,
    positive,
    seed_number,
    set_field,
    value,
    whole,
)
from plenoptic.errors import FileError, InvalidValueError
from plenoptic.rendering.points.particle_scene import particle_scene
from plenoptic.rendering.points.particle_tracing import (
    MAX_RAYS,
    REPLICATES,
    RayNumber,
    choose_rays,
    trace_particles,
    whole_replicates,
)
from plenoptic.scene.points import Points

if TYPE_CHECKING:
    from plenoptic.scene.scene import Scene

TARGET_ERROR = 0.01
"""Standard error of a particle's light over its light, by which rays are chosen unless they are given."""
_INTEGERS: dict[str, Any] = {"shape": np.int64, "indptr": np.int64, "pixel": np.int32}
_FLOATS: dict[str, Any] = {"weight": np.float32, "weight_error": np.float32}
_FLOATS |= dict.fromkeys(("light", "light_error", "centroid", "intensity"), np.float64)
_NAMES = (*_INTEGERS, *_FLOATS, "pitch", "rays", "seed")
_SUFFIXES = (".npz", ".h5", ".hdf5")


@value
class PointWeights:
    """Weights of particles in pixels. See `point_weights`, which makes it.

    Attributes
    ----------
    indptr : (n + 1,) array of int
        Row k of the sparse matrix, particle k, has the entries indptr[k] ... indptr[k + 1] - 1.
    pixel : (m,) array of int
        Pixel of each entry, row times number of columns plus column.
    weight : (m, C) array
        Solid angle in sr at the particle whose light reaches the pixel, times the fraction of it, and of the light of
        the sheet, that passes media; C is 3 for cameras with a spectral sensitivity of three channels, for light of the
        particle's own colour, and in coloured media, otherwise 1.
    weight_error : (m, C) array
        Standard error of each weight.
    light, light_error : (n,) array
        Sum of the weights of each particle, the mean over the channels, and its standard error.
    centroid : (n, 2) array
        Row and column of the centroid of each particle's light on the sensor; nan without light.
    intensity : (n, 1) or (n, 3) array
        Radiant intensities without media, in radiance times mm^2, by which weights are multiplied.
    shape : (2,) array of int
        Rows and columns of the sensor.
    pitch : float
        Pixel pitch in mm.
    rays, seed : int
        Rays of each particle, and the seed of their random numbers.

    Raises
    ------
    InvalidValueError
        If arrays do not fit each other, a pixel lies outside the sensor, or a number is not finite or negative.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.camera.example_camera(pl.CameraKind.CONVENTIONAL)
    >>> weights = pl.rendering.point_weights(pl.Points([(0, 0, -404), (5, 0, -404)], intensity=[1.0, 2.0]), camera)
    >>> weights.matrix().shape, abs(weights.matrix().sum(axis=1) / weights.light - 1).max() < 1e-6
    ((2, 262144), np.True_)
    """

    indptr: NDArray[np.int64]
    pixel: NDArray[np.int32]
    weight: NDArray[np.float32]
    weight_error: NDArray[np.float32]
    light: Floats
    light_error: Floats
    centroid: Floats
    intensity: Floats
    shape: NDArray[np.int64]
    pitch: float
    rays: int
    seed: int

    def __post_init__(self) -> None:
        for name in (*_INTEGERS, *_FLOATS):
            array = np.asarray(getattr(self, name))
            if array.dtype.kind not in ("iu" if name in _INTEGERS else "f"):
                numbers_of = "whole numbers" if name in _INTEGERS else "floating-point numbers"
                raise InvalidValueError(f"{name} holds {array.dtype}; it must hold {numbers_of}")
            set_field(self, name, array)
        self._check_shapes()
        rows, columns = checked_shape(tuple(self.shape.tolist()), ("rows", "columns"))
        if self.indptr[0] != 0 or self.indptr[-1] != len(self.pixel) or (np.diff(self.indptr) < 0).any():
            raise InvalidValueError(f"indptr must ascend from 0 to {len(self.pixel)}, the number of weights")
        if len(self.pixel) and not 0 <= self.pixel.min() <= self.pixel.max() < rows * columns:
            raise InvalidValueError(f"pixel must be from 0 to {rows * columns - 1}, as shape has {rows} x {columns}")
        for name in _FLOATS:
            array = getattr(self, name)
            if (name != "centroid" and not np.isfinite(array).all()) or (name.endswith("error") and (array < 0).any()):
                raise InvalidValueError(f"{name} holds a number that is not finite, or a negative error")
        for name, dtype in (_INTEGERS | _FLOATS).items():
            set_field(self, name, contiguous(getattr(self, name).astype(dtype, copy=False)))
        positive(self.pitch, "pitch", "mm")
        whole(self.rays, "rays", at_least=1)
        seed_number(self.seed)

    def _check_shapes(self) -> None:
        n, m = self.light.size, self.pixel.size
        channels, colours = (3 if getattr(self, name).shape[-1:] == (3,) else 1 for name in ("weight", "intensity"))
        shapes: dict[str, tuple[int, ...]] = {
            "shape": (2,),
            "indptr": (n + 1,),
            "pixel": (m,),
            "light": (n,),
            "light_error": (n,),
        }
        shapes |= {"weight": (m, channels), "weight_error": (m, channels)}
        shapes |= {"centroid": (n, 2), "intensity": (n, colours)}
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise InvalidValueError(f"{name} has shape {getattr(self, name).shape}; it must have shape {shape}")

    def __len__(self) -> int:
        return len(self.light)

    def __repr__(self) -> str:
        return f"PointWeights({len(self)} particles, {len(self.pixel)} weights)"

    def matrix(self, channel: int = 0) -> Any:
        """Weights of a channel as a sparse matrix (particles, pixels), a `scipy.sparse.csr_array`; needs scipy."""
        k = whole(channel, "channel", at_least=0, at_most=self.weight.shape[1] - 1)
        sparse = extra_package("scipy.sparse", "a sparse matrix", "scipy")
        shape = len(self), int(np.prod(self.shape))
        return sparse.csr_array((np.ascontiguousarray(self.weight[:, k]), self.pixel, self.indptr), shape=shape)

    def image(self, intensity: ArrayLike | None = None) -> tuple[Floats, Floats]:
        """Image of the particles and its standard error, (rows, columns, channels), as of `render`: weights times
        intensities over the area of a pixel.

        Parameters
        ----------
        intensity : (n,) or (n, 3) array, optional
            Other intensities; (n,) only with weights of several channels. None: those of the particles.

        Examples
        --------
        >>> import plenoptic as pl
        >>> camera = pl.camera.example_camera(pl.CameraKind.CONVENTIONAL)
        >>> weights = pl.rendering.point_weights(pl.Points([(0, 0, -404)], intensity=2.0), camera)
        >>> bool((weights.image([3.0])[0] == 1.5 * weights.image()[0]).all())
        True
        """
        from plenoptic.rendering.points.kernels.particle_rays import add_entries

        factors = self.intensity
        if intensity is not None:
            factors = numbers(intensity, "intensity")
            factors = factors[:, None] if factors.ndim == 1 else factors
            columns = (1,) if self.weight.shape[1] > 1 else (1, 3)
            if factors.ndim != 2 or len(factors) != len(self) or factors.shape[1] not in columns:
                raise InvalidValueError(f"intensity has shape {np.shape(intensity)}; it must hold one of each particle")
        channels = max(self.weight.shape[1], factors.shape[1])
        image, variance = np.zeros((2, int(np.prod(self.shape)), channels))
        entries = self.pixel, self.weight, self.weight_error
        add_entries(image, variance, np.diff(self.indptr), entries, np.ascontiguousarray(factors) / self.pitch**2)
        return image.reshape(*self.shape, channels), np.sqrt(variance).reshape(*self.shape, channels)

    def displacement(self, later: PointWeights) -> Floats:
        """Displacement (n, 2) in rows and columns of the centroid of each particle's light, in a later exposure.

        The seed and the rays of both exposures must be the same, so that their errors nearly cancel. nan without light.
        """
        check_kind(later, "later", PointWeights, "pl.rendering.point_weights(points.moved(velocity, dt), camera)")
        if len(later) != len(self):
            raise InvalidValueError(f"later has {len(later)} particles; it must have the same {len(self)}")
        if (later.rays, later.seed) != (self.rays, self.seed):
            raise InvalidValueError(
                f"later has {later.rays} rays of each particle and the seed {later.seed}, and these weights have "
                f"{self.rays} and {self.seed}, whose errors do not cancel; trace both with the same rays= and seed="
            )
        return np.asarray(later.centroid - self.centroid)

    def pixel_means(self, values: ArrayLike) -> Floats:
        """Means (rows, columns, k) of values (n, k) of particles in each pixel, weighted by their light there.

        With `displacement`, or velocities, the truth of each pixel; nan in pixels without light.
        """
        table = numbers(values, "values")
        if table.ndim != 2 or len(table) != len(self):
            raise InvalidValueError(f"values has shape {table.shape}; it must have shape ({len(self)}, k)")
        of_entries = np.repeat(np.arange(len(self)), np.diff(self.indptr))
        light = self.weight.mean(axis=1) * self.intensity.mean(axis=1)[of_entries]
        total, n = np.bincount(self.pixel, light, int(np.prod(self.shape))), int(np.prod(self.shape))
        sums = [np.bincount(self.pixel, light * column[of_entries], n) for column in table.T]
        with np.errstate(invalid="ignore"):
            return np.asarray((np.stack(sums, axis=-1) / total[:, None]).reshape(*self.shape, -1))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write all arrays to a `.npz` file, or to a `.h5` or `.hdf5` file (needs h5py).

        Examples
        --------
        >>> import pathlib, tempfile, plenoptic as pl
        >>> points = pl.Points([(0, 0, -404)], intensity=1.0)
        >>> weights = pl.rendering.point_weights(points, pl.camera.example_camera(), rays=128)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     weights.save(pathlib.Path(folder) / "weights.npz")
        ...     pl.rendering.PointWeights.load(pathlib.Path(folder) / "weights.npz") == weights
        True
        """
        target = _checked_path(path)
        arrays = {name: np.asarray(getattr(self, name)) for name in _NAMES}
        if target.suffix == ".npz":
            write_npz(target, arrays)
            return
        file = io.BytesIO()
        with extra_package("h5py", "this file", "h5py").File(file, "w") as opened:
            for name, array in arrays.items():
                opened[name] = array
        write_file(target, file.getvalue())

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, limits: FileLimits = DEFAULT) -> PointWeights:
        """Read a file that `save` wrote; FileError if it is missing or damaged."""
        source = _checked_path(path)
        with content_errors(os.fspath(source)):
            if source.suffix == ".npz":
                arrays = dict(read_npz(source, limits))
            else:
                from plenoptic.core.files.hdf5_files import numbers_at, read_apart

                content = read_file(source, limits)
                arrays = {name: read_apart(numbers_at, content, limits, name)[name] for name in _NAMES}
            pitch, rays, seed = (arrays[name].item() for name in ("pitch", "rays", "seed"))
            return cls(**{name: arrays[name] for name in (*_INTEGERS, *_FLOATS)}, pitch=pitch, rays=rays, seed=seed)


def _checked_path(path: Any) -> Any:
    target = file_path(path)
    if target.suffix not in _SUFFIXES:
        raise FileError(f"{os.fspath(target)!r} has the suffix {target.suffix!r}; it must be one of {_SUFFIXES}")
    return target


def point_weights(
    points: Points,
    camera: PlenopticCamera,
    *,
    scene: Scene | None = None,
    rays: int | None = None,
    target_error: float = TARGET_ERROR,
    seed: int = 0,
    threads: int | None = None,
    progress: bool = True,
) -> PointWeights:
    """Trace particles to the sensor: the pixels that each one illuminates, and its weight in each.

    Rays start at the particle, aimed at its entrance pupil, and pass lens, microlenses and pixels with all that
    attenuates or deflects them in `render`, diffraction included. With `PlenopticCamera.sensitivity` they have 16
    wavelengths. The exposure is at the middle of a shutter.

    Parameters
    ----------
    points : Points
    camera : PlenopticCamera
    scene : Scene, optional
        Scene whose meshes hide particles: each ray is stopped by the first surface before the particle's centre, glass
        included, except within 1/4096 of the distance to the lens; partly transparent ones pass 1 - opacity.
    rays : int, optional
        Rays of each particle, at most 2^18, rounded up to whole replicates. None: chosen by `target_error`.
    target_error : float, optional
        Standard error of a particle's light over its light, as the mean over 64 of the particles.
    seed, threads, progress : optional
        As for `render`. The result does not depend on threads.

    Raises
    ------
    InvalidValueError
        If a particle is not in front of the lens, or an argument is invalid; for microlenses with the model PINHOLE.
    SceneError
        If a particle lies inside a body of glass.

    Notes
    -----
    Weights are means over 8 scramblings of the rays, whose variance gives the standard errors. The random numbers of a
    particle follow from its index, and are those of the same particle in a later exposure.

    Examples
    --------
    >>> import plenoptic as pl
    >>> points = pl.Points([(0, 0, -404), (1, 0, -404)], intensity=1.0)
    >>> weights = pl.rendering.point_weights(points, pl.camera.example_camera())
    >>> len(weights), bool((weights.light_error < 0.02 * weights.light).all())
    (2, True)
    """
    check_kind(points, "points", Points, "pl.Points(positions, intensity=1.0)")
    check_kind(camera, "camera", PlenopticCamera, "pl.PlenopticCamera(...)")
    if scene is not None:
        from plenoptic.scene.scene import Scene

        check_kind(scene, "scene", Scene, "pl.Scene(...)")
    if rays is not None:
        whole(rays, "rays", at_least=1, at_most=MAX_RAYS)
    target, seed, workers = positive(target_error, "target_error"), seed_number(seed), thread_count(threads)
    check_focusing(camera)
    with CallProgress("tracing particles", kind="camera", show=progress):
        traced = particle_scene(points, camera, scene, seed)
        n = choose_rays(traced, target, workers).rays if rays is None else whole_replicates(traced, rays)
        parts = list(trace_particles(traced, RayNumber(n), workers))
    moments = np.concatenate([part.moments for part in parts])
    counts = np.concatenate([part.counts for part in parts])
    columns: list[Any] = [[part.entries[k] for part in parts] for k in range(3)]
    del parts
    # Parts are dropped once they are joined: not two copies of all columns at once.
    for k in range(3):
        columns[k] = np.concatenate(columns[k])
    light = np.ascontiguousarray(moments[:, :, 0])
    with np.errstate(invalid="ignore", divide="ignore"):
        position = centroids(moments)[0]
    position[~(light.mean(axis=1) > 0)] = np.nan
    return PointWeights(
        indptr=np.concatenate([[0], np.cumsum(counts)]),
        pixel=columns[0],
        weight=columns[1],
        weight_error=columns[2],
        light=light.mean(axis=1),
        light_error=light.std(axis=1, ddof=1) / np.sqrt(REPLICATES),
        centroid=camera.sensor.pixel_of(position),
        intensity=traced.intensity,
        shape=np.array(camera.sensor.shape),
        pitch=camera.sensor.pixel_pitch,
        rays=n,
        seed=seed,
    )
