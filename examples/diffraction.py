"""
What diffraction changes
========================

Light bends at the opening of a microlens, by about the wavelength over its width. Whether that shows on pixels depends
on the camera: here that of T. Michels et al. (2018), one as fast and fine as industrial focused cameras (2.0) with
f/2.4 and pixels of 5.5 um, and a light-field microscope (M. Levoy et al., ACM Trans. Graph. 25 (2006),
doi:10.1145/1141911.1141976; M. Broxton et al., Opt. Express 21 (2013), doi:10.1364/OE.21.025418) with microlenses of
125 um and f/20 before pixels of 7.4 um. Each is rendered with ``diffraction=pl.Diffraction()`` and without.
"""

# sphinx_gallery_thumbnail_number = 1

# %%
import dataclasses
import os
from pathlib import Path
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np

import plenoptic as pl

SMALL = os.environ.get("PLENOPTIC_EXAMPLE_SIZE") == "small"
SAMPLES = 8 if SMALL else 64
DEPTHS = 2 if SMALL else 7
GREEN = 550.0  # nm

output = Path("output/diffraction")
output.mkdir(parents=True, exist_ok=True)

# %%
# Three cameras
# -------------
#
# The main lens of the fast one is ideal, so that its aberrations do not hide what microlenses do. Objective and tube
# lens of the microscope are one ideal lens of 10 mm with its iris in it: 20 times, f/20 on the side of the array, and
# rays of a slope of up to 1/2 on that of the specimen.

double_gauss = pl.load_lens("double-gauss-100mm-f2")
paper = pl.PlenopticCamera(
    lens=double_gauss.with_stop(pl.CircularStop(semi_diameter=5.0)),
    microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)),
    sensor=pl.Sensor(shape=(280, 280), pixel_pitch=0.010),
    stop_to_microlenses=123.3,
    microlenses_to_sensor=1.7,
    wavelength=GREEN,
)
round_ones = pl.optics.MicrolensAperture(pl.optics.ApertureShape.CIRCLE, fill_factor=0.9)
fast = pl.design_camera(
    double_gauss.with_model(pl.LensModel.PARAXIAL),
    sensor=pl.Sensor(shape=(200, 200), pixel_pitch=0.0055),
    z=-1000.0,
    kind=pl.CameraKind.GALILEAN,
    microlenses=pl.MicrolensArray(pitch=0.127, focal_lengths=(0.4,), aperture=round_ones),
    virtual_depth=4.0,
    image_fill=0.95,
    wavelength=GREEN,
).camera
glass = pl.ConstantMedium(2.0)
objective = pl.LensStack(
    [pl.CircularStop(5.25), pl.Surface(20.0, medium=glass, semi_diameter=6.0), pl.Surface(-20.0, semi_diameter=6.0)],
    model=pl.LensModel.THIN,
)
microscope = pl.PlenopticCamera(
    lens=objective,
    microlenses=pl.MicrolensArray(pitch=0.125, focal_lengths=(2.5,), lattice=pl.Lattice.SQUARE),
    sensor=pl.Sensor(shape=(420, 420), pixel_pitch=0.0074),
    stop_to_microlenses=210.0,
    microlenses_to_sensor=2.5,
    wavelength=GREEN,
)


class Case(NamedTuple):
    """A camera, the plane in focus and those of stars in mm, the one that is shown, and their line pairs per mm."""

    camera: pl.PlenopticCamera
    in_focus: float
    depths: np.ndarray
    shown: float
    frequency: float


cases = {
    "paper's camera, f/7.8, 10 um": Case(paper, -404.0, np.linspace(-344, -464, DEPTHS), -404.0, 1.2),
    "fast camera, f/2.4, 5.5 um": Case(fast, -1000.0, np.linspace(-955, -1045, DEPTHS), -1000.0, 1.2),
    "microscope, f/20, 7.4 um": Case(microscope, -10.5, np.linspace(-10.38, -10.62, DEPTHS), -10.42, 40.0),
}


def bending(camera):
    """The same with diffraction at microlenses."""
    return dataclasses.replace(camera, diffraction=pl.Diffraction())


# %%
# What optics says
# ----------------
#
# Bending blurs the raw image by the far-field pattern of the opening, which takes from a wave of the frequency nu on
# the sensor all but the overlap of the opening with itself, moved by wavelength b nu (J. W. Goodman, Introduction to
# Fourier Optics, section 6.3). The main lens images a plane at the distance a behind the array m times as large, and
# the microlens that b / a times as large again.


def opening_mtf(camera, frequency):
    """Part of the opening that overlaps itself, moved along each of many directions."""
    opening = camera.microlenses.opening
    place = np.linspace(-1, 1, 201) * np.abs(opening.corners).max()
    points = np.stack(np.meshgrid(place, place), axis=-1).reshape(-1, 2)
    ahead = np.roll(opening.corners, -1, axis=0) - opening.corners

    def inside(p):
        beside = [u * (p[:, 1] - c[1]) - v * (p[:, 0] - c[0]) for c, (u, v) in zip(opening.corners, ahead, strict=True)]
        return np.all(np.array(beside) >= 0, axis=0) & (np.hypot(*p.T) <= opening.radius)

    here = inside(points)
    step = 1e-6 * camera.wavelength * camera.microlenses_to_sensor * frequency
    angles = np.linspace(0, np.pi, 24, endpoint=False)
    moved = [inside(points + step * np.array([np.cos(a), np.sin(a)])) for a in angles]
    return float(np.mean([np.mean(there[here]) for there in moved]))


def on_sensor(case, z):
    """Line pairs per mm under a microlens of those of the star at z."""
    camera = case.camera
    behind = pl.paraxial.image_position(camera.lens, z) - camera.stop_to_microlenses
    larger = abs(pl.paraxial.magnification(camera.lens, z))
    return case.frequency * abs(behind) / (larger * camera.microlenses_to_sensor)


print("contrast that microlenses leave at the finest wave that pixels tell:")
for name, case in cases.items():
    nyquist = 0.5 / case.camera.sensor.pixel_pitch
    print(f"  {name}: {opening_mtf(case.camera, nyquist):.2f}")

# %%
# Stars in views
# --------------
#
# A star has 16 shining spokes. The pictures of focused cameras are put together for its plane, of
# the microscope the central sub-aperture view is taken. In the ring where the star has the frequency of the case, a
# constant and the wave of the spokes are fitted; 1 is the contrast of spokes that are black and white.


SPOKES = 16


def star(case, z):
    """A star around the axis, and the radius of the ring that is looked at."""
    ring = SPOKES / (2 * np.pi * case.frequency)
    target = pl.targets.siemens_star(1.3 * ring, SPOKES, dark=pl.Emissive(0.0), bright=pl.Emissive(1.0))
    return pl.Scene(target.translated(z=z).meshes), ring


def view_of(shot, white, z):
    """A picture, and what says where its pixels look."""
    camera = shot.camera
    if camera.microlenses_to_sensor == camera.microlenses.focal_length:
        field = pl.lightfield.decode(shot, white, views=1)
        return field, field.centre[:, :, 0]
    view = pl.lightfield.render_view(shot, white, z=z, spacing=camera.microlenses.pitch / 8, progress=False)
    return view, view.picture[:, :, 0]


def contrast(case, shot, white, z):
    """Amplitude over mean of the wave of the spokes in the ring, over 4 / pi."""
    view, picture = view_of(shot, white, z)
    scene, ring = star(case, z)
    x, y = np.moveaxis(view.truth(scene, truth=pl.Truth.POSITION).position[..., :2], -1, 0)
    near = np.isfinite(picture) & (np.abs(np.hypot(x, y) - ring) < 0.25 / case.frequency)
    phase = SPOKES * np.arctan2(y, x)[near]
    waves = np.column_stack([np.ones(phase.size), np.cos(phase), np.sin(phase)])
    mean, *swing = np.linalg.lstsq(waves, picture[near], rcond=None)[0]
    return np.pi / 4 * float(np.hypot(*swing) / mean)


raw, found = {}, {}
for name, case in cases.items():
    print(f"{name}\n     z / mm   contrast without   with   without times the opening's")
    cameras = case.camera, bending(case.camera)
    whites = [pl.render_white(camera, samples=SAMPLES, seed=1, progress=False) for camera in cameras]
    found[name] = []
    for z in case.depths:
        scene, _ = star(case, z)
        shots = [pl.render(scene, camera, samples=SAMPLES, truth=pl.Truth.NONE, progress=False) for camera in cameras]
        values = [contrast(case, shot, white, z) for shot, white in zip(shots, whites, strict=True)]
        found[name].append((*values, values[0] * opening_mtf(case.camera, on_sensor(case, z))))
        print(f"{z:11.2f} {values[0]:18.3f} {values[1]:6.3f} {found[name][-1][2]:11.3f}")
        if z == min(case.depths, key=lambda z: abs(z - case.shown)):
            raw[name] = z, shots

# %%
# Diffraction multiplies contrast by what the overlap of the opening says, at all depths: it takes 7 % in the fast
# camera, 12 % in the paper's. In the microscope it blurs directions rather than places. In focus all pixels under a
# microlens see the same place, and the view stays as it was; away from it, blurred directions see different places.
# What is left is up to 5 % above the product: spokes are no grating, and a Fourier transform of the star says as much.


def part_of(case, z):
    """64 x 64 pixels of the sensor around the image of a point of the ring."""
    camera, middle = case.camera, case.camera.sensor.shape[0] // 2
    larger = abs(pl.paraxial.magnification(camera.lens, z))
    larger *= camera.stop_to_microlenses / pl.paraxial.image_position(camera.lens, z)  # where chief rays pass the array
    column = middle + round(star(case, z)[1] * larger / camera.sensor.pixel_pitch)
    return np.s_[middle - 32 : middle + 32, column - 32 : column + 32]


figure, axes = plt.subplots(3, 3, figsize=(12, 11), layout="constrained", width_ratios=(1, 1, 1.35))
for row, (name, case) in zip(axes, cases.items(), strict=True):
    z, shots = raw[name]
    rows, columns = part_of(case, z)
    top = np.percentile(shots[0].image[rows, columns], 99.5)
    for ax, shot, title in zip(row, shots, ("rays alone", "with diffraction"), strict=False):
        extent = (columns.start - 0.5, columns.stop - 0.5, rows.stop - 0.5, rows.start - 0.5)
        picture = shot.image[rows, columns, 0] / top
        ax.imshow(picture, cmap="gray", vmin=0, vmax=1, extent=extent, interpolation="nearest")
        ax.set(xlabel="column / pixel", ylabel="row / pixel", title=f"{title}, star at {-z:.6g} mm")
    without, bent, expected = np.transpose(found[name])
    row[2].plot(-case.depths, without, "o-", color="tab:blue", label="rays alone")
    row[2].plot(-case.depths, expected, color="0.6", linewidth=5, label="times overlap of the opening")
    row[2].plot(-case.depths, bent, "o-", color="tab:orange", label="with diffraction")
    row[2].axvline(-case.in_focus, color="0.5", linestyle=":", linewidth=1)
    row[2].set(xlabel="depth of the star / mm; dotted: in focus", ylabel="contrast in views", ylim=(0, 1))
    row[2].set_title(f"{name}: {case.frequency:g} line pairs/mm", fontsize=10)
    row[2].grid(alpha=0.3)
axes[0, 2].legend(fontsize=9)
figure.savefig(output / "diffraction.png", dpi=80)

# %%
# Error against run time
# ----------------------
#
# The same stars, compared with converged images with diffraction. The noise of both ways falls as samples grow; what
# rays alone leave out stays.

samples = (16, 64) if SMALL else (16, 64, 256)
tables = {}
for name, case in cases.items():
    z = raw[name][0]
    place = tuple(slice(part.start + 24, part.start + 40) for part in part_of(case, z)) if SMALL else part_of(case, z)
    tables[name] = pl.study.error_against_time(
        star(case, z)[0], bending(case.camera),
        {"with diffraction": pl.study.Variant(), "rays alone": pl.study.Variant(camera=case.camera)},
        samples=samples, region=place, seeds=2 if SMALL else 4, reference_samples=4 * samples[-1], title=name,
        progress=False,
    )  # fmt: skip


def seconds_at(rows, noise):
    """CPU seconds that a noise takes, on a straight line through the last two rows in logarithms."""
    line = np.polyfit(*np.log([(row.noise, row.cpu_seconds) for row in rows[-2:]]).T, 1)
    return np.exp(np.polyval(line, np.log(noise)))


print(f"errors in % of the light, with {samples[-1]} samples; cost: CPU time at equal noise over that of rays alone")
print("  bias of rays   noise of rays   with diffraction   cost")
for name, table in tables.items():
    rays, bent = (table.of(kind) for kind in ("rays alone", "with diffraction"))
    noise = bent[-1].noise
    cost = seconds_at(bent, noise) / seconds_at(rays, noise)
    floor = 100 * table.bias_floor("rays alone")
    print(f"{floor:14.1f} {100 * rays[-1].noise:15.2f} {100 * noise:18.2f} {cost:6.2f}   {name}")

figure, axes = plt.subplots(1, 3, figsize=(12, 4), layout="constrained", sharey=True)
for ax, (name, table) in zip(axes, tables.items(), strict=True):
    for kind, colour in (("rays alone", "tab:blue"), ("with diffraction", "tab:orange")):
        rows = table.of(kind)
        ms = [1e3 * row.cpu_seconds / table.pixels for row in rows]
        ax.loglog(ms, [100 * row.error for row in rows], "o-", color=colour, label=kind)
        ax.loglog(ms, [100 * row.noise for row in rows], ":", color=colour, label=f"{kind}: noise")
    ax.set(xlabel="CPU time / (ms / pixel)")
    ax.set_title(name, fontsize=10)
    for axis, ticks in ((ax.xaxis, (0.01, 0.03, 0.1, 0.3)), (ax.yaxis, (1, 2, 5, 10, 20, 50))):
        axis.set_ticks(ticks, [f"{tick:g}" for tick in ticks])
        axis.set_ticks([], minor=True)
    ax.grid(alpha=0.3)
axes[0].set_ylabel("relative error of a pixel / %")
axes[0].legend(fontsize=9)
figure.savefig(output / "error_against_time.png", dpi=80)
print("written:", output / "diffraction.png", output / "error_against_time.png", sep="\n  ")
