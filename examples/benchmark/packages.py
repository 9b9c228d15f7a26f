"""Pictures of the scenes, rendered to a stated error, as packages in files."""

import functools

import numpy as np

import plenoptic as pl

TRUTH = pl.Truth.DEPTH | pl.Truth.MICROLENS | pl.Truth.CHORD_DISPARITY
FULL = 99.0  # percentile of a picture that is as bright as its sensor is meant for


def package(path, case, camera, *, error, seed=0):
    """The package of a case, rendered to a relative error where the file is not there yet."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        shot, scene = exposure(case.make, camera, error, seed), case.make()
        sensor = read_out(shot, case.sensor)
        pl.package.write(path, shot, white_image(camera, error, seed), sensor=sensor, scene=scene, seed=seed)
    return pl.package.read(path)


@functools.lru_cache(maxsize=1)
def exposure(make, camera, error, seed):
    """The light of a scene, once for all sensors that read it out one after the other."""
    return pl.render(make(), camera, target_error=error, truth=TRUTH, seed=seed, progress=False)


@functools.lru_cache(maxsize=1)
def white_image(camera, error, seed):
    # With other paths than the scene's, whose errors it must not share; and its error is to be small beside theirs.
    return pl.render_white(camera, target_error=error / 4, seed=seed + 1, progress=False)


def read_out(shot, sensor):
    """A sensor of 12 bits, 3 electrons of noise and wells that a fifth more than the wanted electrons fill."""
    if sensor.electrons is None:
        return None
    well = 1.2 * sensor.electrons
    return pl.SensorModel(
        photon_rate=sensor.electrons / float(np.percentile(shot.image, FULL)),
        gain=3900 / well,
        black_level=64,
        full_well=well,
        read_noise=3.0,
        prnu=0.01,
        colour_filters=sensor.filters,
    )
