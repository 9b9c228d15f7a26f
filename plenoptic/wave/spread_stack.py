"""Wave-optical images of points at several depths and positions within a microlens, for deconvolution."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from plenoptic.camera.assembly import array_axes
from plenoptic.camera.camera import PlenopticCamera
from plenoptic.core.parallel import run_in_order, thread_count
from plenoptic.core.progress.bar import CallProgress
from plenoptic.core.values import Floats, check_kind, numbers, result, whole
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.pupil.ray_aiming import aimed_rays_reverse
from plenoptic.optics.microlens.lattice import Lattice
from plenoptic.optics.stops.stop_registry import Stop, is_circle
from plenoptic.wave.point_image import point_spread
from plenoptic.wave.wave_spread import WaveSpread

_MAX_ACROSS = 255


@result
class WaveSpreadStack:
    """Images of points at several depths, at positions whose light sweeps over the central microlens.

    Made by `point_spread_stack`.

    Attributes
    ----------
    images : (depths, across, across, rows, columns) array of float32
        As `WaveSpread.image`, on a central part of the sensor. Positions (i, j) follow the rows and columns of
        the image: from one to the next, the light moves by 1 / across of a microlens down, or to the right.
    corner : (2,) array of int
        Row and column on the sensor of the first pixel of images.
    points : (depths, across, across, 3) array
        World positions, mm.
    z_objects : (depths,) array
        Depths as passed to `point_spread_stack`.
    light : (depths, across, across) array
        Projected solid angle in sr of the light that passes the main lens.
    error : float
        The largest `Sampling.error`.
    camera : PlenopticCamera

    Examples
    --------
    >>> import plenoptic as pl
    >>> lens = pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(semi_diameter=4.25))
    >>> camera = pl.PlenopticCamera(lens=lens, sensor=pl.Sensor(shape=(255, 255), pixel_pitch=0.01),
    ...     microlenses=pl.MicrolensArray(pitch=0.21, focal_lengths=(2.0,), lattice=pl.Lattice.SQUARE),
    ...     stop_to_microlenses=123.3, microlenses_to_sensor=2.0)
    >>> stack = pl.wave.point_spread_stack(camera, [-500.0], across=1, progress=False)
    >>> stack.images.shape[:3], stack.images.dtype.name
    ((1, 1, 1), 'float32')
    """

    images: NDArray[np.float32]
    corner: NDArray[np.int64]
    points: Floats
    z_objects: Floats
    light: Floats
    error: float
    camera: PlenopticCamera

    def __repr__(self) -> str:
        depths, across, _, rows, columns = self.images.shape
        return f"<WaveSpreadStack: {depths} depths, {across} x {across} places, {rows} x {columns} pixels>"


def point_spread_stack(
    camera: PlenopticCamera,
    z_objects: ArrayLike,
    *,
    across: int,
    wavelengths: float | Sequence[float] | None = None,
    weights: ArrayLike | None = None,
    threads: int | None = None,
    progress: bool = True,
) -> WaveSpreadStack:
    """Images of points at several depths, for the deconvolution of raw images of a microscope.

    Parameters
    ----------
    camera : PlenopticCamera
        Its microlenses on a SQUARE or RECTANGULAR lattice.
    z_objects : (depths,) array
        Planes in the lens's axes, mm, negative: in the axes of the iris for an undisplaced lens.
    across : int
        Positions along both axes within a microlens.
    wavelengths, weights
        As in `point_spread`.
    threads : int, optional
        None: one for each processor. Each holds a grid of samples and half a dozen copies.
    progress : bool, optional
        Show a progress bar.

    Returns
    -------
    WaveSpreadStack

    Raises
    ------
    InvalidValueError
        As for `point_spread`; for other lattices; or if no ray from the middle of the iris reaches a position.

    Notes
    -----
    Points of a depth lie on rays through the middle of the iris and the positions on the array. If the main lens is
    nearly telecentric, each represents all points whose light is displaced by whole microlenses. For cameras that are
    symmetric in their axes only a quarter of the positions is calculated.

    Examples
    --------
    See `WaveSpreadStack`, and `pl.export.pyolaf_patterns` for files.
    """
    check_kind(camera, "camera", PlenopticCamera, "pl.camera.example_camera()")
    array = camera.microlenses
    if array is None or array.lattice not in (Lattice.SQUARE, Lattice.RECTANGULAR):
        raise InvalidValueError(
            "patterns repeat along x and y behind SQUARE and RECTANGULAR lattices alone; use point_spread for others"
        )
    depths = numbers(z_objects, "z_objects")
    if depths.ndim != 1 or not len(depths):
        raise InvalidValueError("z_objects must be a row of numbers, such as [-110.0, -100.0]")
    count = whole(across, "across", at_least=1, at_most=_MAX_ACROSS)
    points = _points(camera, depths, count)
    n_computed = (count + 1) // 2 if _is_symmetric(camera) else count

    def spread_at(index: tuple[int, ...]) -> WaveSpread:
        return point_spread(camera, points[index], wavelengths=wavelengths, weights=weights)

    indices = list(np.ndindex(len(depths), n_computed, n_computed))
    with CallProgress("propagating waves", kind="camera", show=progress):
        results = run_in_order(spread_at, indices, threads=thread_count(threads), ahead=1)
        spreads = dict(zip(indices, results, strict=True))
    return _stack(camera, depths, points, spreads, n_computed)


def _points(camera: PlenopticCamera, depths: Floats, across: int) -> Floats:
    """World points (depths, across, across, 3)."""
    axes, array = array_axes(camera), camera.microlenses
    assert array is not None
    steps = (np.arange(across) + 0.5) / across - 0.5
    # Images are read out rotated by half a turn about y.
    positions = np.stack(np.meshgrid(-steps * array.pitches[0], steps * array.pitches[1]), axis=-1).reshape(-1, 2)
    points = np.empty((len(depths), len(positions), 3))
    for k, position in enumerate(axes.in_lens(axes.local(positions))):
        ray = aimed_rays_reverse(
            camera.lens,
            image_point=position[:2],
            z_image=float(position[2]),
            pupil=np.zeros((1, 2)),
            wavelength=camera.wavelength,
        )
        behind = camera.lens.trace_reverse(ray)
        if behind.status[0] != 0:
            raise InvalidValueError(
                "no ray leads from the middle of the iris to the middle microlens; centre the parts"
            )
        points[:, k] = [behind.at_z(float(z))[0] for z in depths]
    if axes.parts.lens_to_camera is not None:
        points = axes.parts.lens_to_camera.points(points)
    if camera.pose is not None:
        points = camera.pose.to_world(points.reshape(-1, 3))
    return np.asarray(points).reshape(len(depths), across, across, 3)


def _is_symmetric(camera: PlenopticCamera) -> bool:
    """True if the camera is symmetric in x and in y."""
    array = camera.microlenses
    assert array is not None
    round_stops = all(is_circle(e) for e in camera.lens.elements if isinstance(e, Stop))
    return (
        camera == camera.design
        and array.imperfections is None
        and len(array.focal_lengths) == 1
        and array_axes(camera).lens_is_centred
        and round_stops
    )


def _stack(
    camera: PlenopticCamera, depths: Floats, points: Floats, spreads: dict[tuple[int, ...], WaveSpread], n_computed: int
) -> WaveSpreadStack:
    """Stack of images on the central part of the sensor that holds all of them."""
    across, sensor = points.shape[1], np.array(camera.sensor.shape)
    lit = [spread for spread in spreads.values() if spread.light > 0]
    margin = sensor.min() // 2 if not lit else sensor.max()
    first = np.full(2, margin)
    for spread in lit:
        last = spread.corner + spread.image.shape
        first = np.minimum(first, np.minimum(spread.corner, sensor - last))
    shape = sensor - 2 * first
    images = np.zeros((len(depths), across, across, *shape), np.float32)
    light = np.zeros(images.shape[:3])
    for (depth, i, j), spread in spreads.items():
        (row, column), (rows, columns) = spread.corner - first, spread.image.shape
        image = np.zeros(shape, np.float32)
        if spread.light > 0:
            image[row : row + rows, column : column + columns] = spread.image
        symmetric = n_computed < across
        for down in {i, across - 1 - i} if symmetric else {i}:
            for right in {j, across - 1 - j} if symmetric else {j}:
                flipped = image[::-1] if down != i else image
                images[depth, down, right] = flipped[:, ::-1] if right != j else flipped
                light[depth, down, right] = spread.light
    error = max((part.error for spread in lit for part in spread.samplings), default=0.0)
    return WaveSpreadStack(images, first, points, depths, light, error, camera)
