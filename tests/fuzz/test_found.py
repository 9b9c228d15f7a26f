"""What fuzzing found, made small."""

import pytest

import plenoptic as pl


def camera(array, microlenses_to_sensor):
    return pl.PlenopticCamera(
        lens=pl.no_lens(1.0),
        sensor=pl.Sensor(shape=(4, 4), pixel_pitch=0.2),
        stop_to_microlenses=2.0,
        microlenses=array,
        microlenses_to_sensor=microlenses_to_sensor,
    )


def test_far_too_many_microlenses_are_refused_with_tiles_of_any_size():
    # The guard was asked only where the size of the tiles was chosen by the package: it took minutes and 75 GB.
    fine = pl.MicrolensArray(pitch=1e-4, focal_lengths=(1e3,))
    for side in (None, 3):
        with pytest.raises(pl.errors.InvalidValueError, match="microlenses, and the limit is 100000"):
            pl.render_white(camera(fine, 1e6), samples=1, tile_side=side, progress=False)
    # Axes that may lie 2.5 m beside their lenses: light of 11 million of them may reach the sensor. They took minutes.
    imperfect = pl.MicrolensImperfections(decentre=440.0)
    far_off = pl.MicrolensArray(pitch=1.9, focal_lengths=(5.0,), imperfections=imperfect)
    with pytest.raises(pl.errors.InvalidValueError, match="have imperfections, and the limit is 4000000"):
        pl.render_white(camera(far_off, 6.0), samples=1, progress=False)
