"""Ground truth of sub-aperture views: along their own rays."""

import numpy as np
import pytest

import plenoptic as pl
from plenoptic.images import PixelState
from plenoptic.truth.channels import Truth

TWO_PLANES = pl.Scene(
    [
        pl.quad((0, -2000, -350), (2000, 0, 0), (0, 4000, 0), material=pl.Emissive(1.0)),
        pl.quad((-2000, -2000, -450), (4000, 0, 0), (0, 4000, 0), material=pl.Emissive(0.5)),
    ]
)


def field_of(lattice=pl.Lattice.HEXAGONAL, model=pl.LensModel.EXACT, moved=False, **array):
    camera = pl.PlenopticCamera(
        lens=pl.load_lens("double-gauss-100mm-f2").with_stop(pl.CircularStop(4.25)).with_model(model),
        microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,), lattice=lattice, **array),
        sensor=pl.Sensor(shape=(160, 180), pixel_pitch=0.01),
        stop_to_microlenses=123.3,
        microlenses_to_sensor=2.0,
    )
    if moved:
        camera = camera.moved(pl.CameraPart.MICROLENSES, tilt=(0.004, -0.003, 0.01)).moved(
            pl.CameraPart.SENSOR, shift=(0.02, 0.01, 0.0)
        )
    white = pl.render_white(camera, samples=16, progress=False)
    return pl.lightfield.decode(white, white, views=5, step=2.0)


@pytest.fixture(scope="module")
def field():
    return field_of()


def test_what_a_view_sees_is_projected_onto_its_pixel_of_the_raw_image():
    # On a square lattice each ray passes the optical centre of a microlens: it is a chief ray.
    for moved, views in ((False, ((2, 0),)), (True, ((0, 0), (-1, 2)))):
        field = field_of(pl.Lattice.SQUARE, moved=moved)
        for u, v in views:
            truth = field.truth(TWO_PLANES, u, v)
            met = truth.state == PixelState.SEEN
            assert met.sum() > 20
            seen = pl.project(field.camera, truth.position[met])
            for k, expected in enumerate((field.pixel + np.array([2.0 * v, 2.0 * u]))[met]):
                assert np.abs(seen.pixel[seen.point == k] - expected).max(axis=1).min() < 1e-6, (moved, u, v)


def test_no_depth_lies_between_objects(field):
    # Depths of a raw image, resampled as its colours are, lay between the planes in a tenth of the pixels.
    for u in (-2, 0, 2):
        truth = field.truth(TWO_PLANES, u, 0)
        seen = truth.state == PixelState.SEEN
        np.testing.assert_array_equal(np.isfinite(field.pixel).all(axis=-1), truth.state != PixelState.UNKNOWN)
        off = np.minimum(np.abs(truth.depth[seen] - 350.0), np.abs(truth.depth[seen] - 450.0))
        assert off.max() < 1e-9 and len(np.unique(truth.object[seen])) == 2


def test_points_move_between_views_by_their_disparity():
    field = field_of(pl.Lattice.SQUARE, pl.LensModel.THIN)
    plane = pl.Scene([pl.quad((-2000, -2000, -350), (4000, 0, 0), (0, 4000, 0))])
    row = field.pixel.shape[0] // 2
    one, other = (field.truth(plane, u, 0).position[row, :, 0] for u in (-1, 1))
    step = np.nanmean(np.diff(one))
    # Two places of a step of two pixels each.
    np.testing.assert_allclose(np.nanmean(other - one) / step, 4 * field.disparity_at(-350.0)[0], rtol=0.02)


def test_what_views_do_not_have(field):
    assert field.truth(TWO_PLANES).kinds == Truth.ALL & ~Truth.MICROLENS
    with pytest.raises(pl.errors.InvalidValueError, match="along rays of a view: they have no microlens"):
        field.truth(TWO_PLANES, truth=Truth.MICROLENS)
    with pytest.raises(pl.errors.InvalidValueError, match="u is 3"):
        field.truth(TWO_PLANES, 3, 0)
