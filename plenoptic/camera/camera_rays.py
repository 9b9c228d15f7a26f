"""Camera rays: from the sensor through array and lens, in the stages that a camera needs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.camera_record import CameraRecord
from plenoptic.camera.dust import BETWEEN, PlacedDust, fill_dust_at_lens
from plenoptic.camera.ghosts.ghost_rays import fill_ghost_rays
from plenoptic.camera.sampling.aperture_regions import aperture_regions
from plenoptic.camera.sampling.kernels import camera_samples, diffraction_deflection
from plenoptic.camera.sampling.sampling_records import Batch, DeflectedSamples, IlluminatedPixels
from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, WEIGHT, X, Y
from plenoptic.core.values import Floats
from plenoptic.optics.coatings.kernels.transmission_fit import fill_fitted_transmission
from plenoptic.optics.lens.kernels.trace import fill_through_lens
from plenoptic.optics.microlens.dust import BlemishSite
from plenoptic.optics.microlens.kernels import to_lens
from plenoptic.optics.microlens.microlens_record import ResponseRecord, SensorPlane, WellsRecord
from plenoptic.optics.microlens.model_records import ArrayCrossing

_GUIDES = 1024
"""Entries of the guide table for cumulative probabilities; see `fill_waves`."""


def fill_losses_before_array(
    blocks: Floats, sensor: SensorPlane, response: ResponseRecord | WellsRecord | None, dust: tuple[PlacedDust, ...]
) -> None:
    """Attenuate aimed samples by the angular response of pixels and by dust between sensor and array."""
    if isinstance(response, WellsRecord):
        to_lens.fill_well_response(blocks, sensor, response)
    elif response is not None:
        to_lens.fill_pixel_response(blocks, sensor, response)
    for blemish in dust:
        if blemish.site in BETWEEN:
            from plenoptic.optics.microlens.kernels.dust_transmission import fill_aim_transmission

            fill_aim_transmission(blocks, sensor, blemish.height, blemish.axes, blemish.record)


def fill_through_array(
    blocks: Floats, lenslets: NDArray[np.void] | None, camera: CameraRecord, waves: NDArray[np.int64] | None = None
) -> None:
    """Trace aimed samples (see `to_lens`) through the array; they become rays towards the lens, in its axes.

    `waves` are the indices of their wavelengths; None for the camera's wavelength.
    """
    array, sensor = camera.array, camera.sensor.plane
    z_plane = camera.parts.z_plane if camera.frame is None else 0.0
    if array is None or camera.microlenses is None:
        to_lens.fill_straight(blocks, sensor, z_plane)
        return
    if array.walls is not None and lenslets is not None:
        to_lens.fill_walls(blocks, lenslets, array.cell, array.cells)
    camera.microlenses.model.refraction.to_lens(blocks, lenslets, ArrayCrossing(array, sensor, z_plane), waves)
    if camera.frame is not None:
        to_lens.fill_in_lens_axes(blocks, camera.frame)


class CameraRays:
    """Bundles of camera rays of illuminated pixels, at most `capacity` rays each; arrays are reused between bundles."""

    def __init__(self, camera: CameraRecord, illuminated: IlluminatedPixels, batch: Batch, capacity: int) -> None:
        blocks = -(-capacity // BLOCK)
        self._camera, self._illuminated, self._batch = camera, illuminated, batch
        self._blocks = np.empty(blocks * RAY)
        self._fill_samples = camera_samples.fill_camera_samples.specialize()
        self._trace_lens = fill_through_lens.specialize()
        self.core = np.empty(blocks * RAY) if illuminated.has_core else None
        """Aimed rays through the unvignetted core, the control variate; None without one. They are traced
        through lenses with losses only, where the camera has no `TransmissionFit`."""
        self.lenslets = camera.lenslet_parameters(blocks * BLOCK)
        """Lenslet parameters of each ray; None if all microlenses are alike."""
        self.waves: NDArray[np.int64] | None = None
        """Wavelength index of each ray; None if all have the camera's wavelength."""
        self.lens = camera.lens
        """Record of the lens through which rays are traced."""
        if camera.colour is not None and camera.dispersed is not None:
            self.waves, self.lens = np.empty(blocks * BLOCK, dtype=np.int64), camera.dispersed
            self._guide = np.searchsorted(camera.colour.cdf, np.arange(_GUIDES) / _GUIDES, side="right")
        assert self.core is None or self.lens.losses is None or self.lenslets is None
        if camera.transmission is not None:
            self.lens = self.lens._replace(losses=None)
        self._distant = None if illuminated.sources is None else np.empty(capacity, dtype=np.int64)
        self.kernel_rows = None if illuminated.kernel is None else np.empty(capacity, dtype=np.int64)
        """Row of the `KernelTable` of each ray; None without a diffraction kernel."""
        self._pairs = None if camera.ghosts is None else np.empty(blocks * BLOCK, dtype=np.int64)
        is_deflected = illuminated.sources is not None or illuminated.kernel is not None
        self._deflected = DeflectedSamples(self._distant, self.kernel_rows, self.waves) if is_deflected else None

    def sample(self, start: int, n: int) -> Floats:
        """Bundle of rays start ... start + n - 1: points on their pixels, aimed at the regions of these points."""
        bundle, colour = self._blocks[: -(-n // BLOCK) * RAY], self._camera.colour
        core = None if self.core is None else self.core[: bundle.size]
        if colour is not None and self.waves is not None:
            number = self._illuminated.number
            camera_samples.fill_waves(self.waves, start, n, self._batch, number, colour.cdf, self._guide)
        if self._pairs is not None and self._camera.ghosts is not None:
            # Numbers that are independent of those of wavelengths.
            batch, ghosts = self._batch._replace(seed=~self._batch.seed), self._camera.ghosts
            pairs = self._pairs[: bundle.size // (RAY // BLOCK)]
            camera_samples.fill_waves(pairs, start, n, batch, self._illuminated.number, ghosts.cumulative, ghosts.guide)
        n_distant = self._fill_samples(
            bundle, core, self.lenslets, self._deflected, start, n, self._batch, self._illuminated
        )
        if self._distant is not None:
            self._sample_distant(bundle, self._distant[:n_distant])
        return bundle

    def _sample_distant(self, bundle: Floats, distant: NDArray[np.int64]) -> None:
        """Aim rays whose light comes from distant pixels: they are few, and their regions are bounds on the pupil."""
        fields = bundle.reshape(-1, RAY // BLOCK, BLOCK)
        starts = np.stack([fields[distant // BLOCK, row // BLOCK, distant % BLOCK] for row in (X, Y)], axis=-1)
        regions = aperture_regions(self._camera._replace(exact=False), starts)
        camera_samples.fill_distant_samples(bundle, self.lenslets, distant, regions)

    def fill_through_array(self, bundle: Floats) -> None:
        """Trace a bundle from the sensor through the array."""
        sensor = self._camera.sensor
        fill_losses_before_array(bundle, sensor.plane, sensor.response, self._camera.dust)
        fill_through_array(bundle, self.lenslets, self._camera, self.waves)
        if self.core is not None:
            core = self.core[: bundle.size]
            fill_losses_before_array(core, sensor.plane, sensor.response, ())
            if self._camera.lens.losses is None:
                to_lens.fill_weights(core, sensor.plane)
            else:
                fill_through_array(core, None, self._camera)

    def fill_iris_deflections(self, bundle: Floats, start: int, n: int) -> None:
        """Deflect rays start ... start + n - 1 in front of the lens by diffraction at the iris, if enabled."""
        if self._camera.iris is not None:
            number = self._illuminated.number
            diffraction_deflection.fill_iris_deflections(
                bundle, start, n, self._batch, number, self.waves, self._camera.iris
            )

    def fill_through_lens(self, bundle: Floats) -> None:
        """Trace a bundle through the lens and the dust on it, then add the weights of the unvignetted core."""
        fit = self._camera.transmission
        fill_dust_at_lens(bundle, self._camera.dust, BlemishSite.LENS_REAR)
        if fit is not None:
            fill_fitted_transmission(bundle, fit, self.waves)
        self._trace_lens(bundle, self.lens, self.waves)
        if self._pairs is not None and self._camera.ghosts is not None:
            fill_ghost_rays(bundle, self._camera.ghosts, self._pairs[: bundle.size // (RAY // BLOCK)], self.waves)
        fill_dust_at_lens(bundle, self._camera.dust, BlemishSite.LENS_FRONT)
        self._scale_radiance(bundle)
        if self.core is not None:
            core = self.core[: bundle.size]
            if fit is not None:
                fill_fitted_transmission(core, fit, self.waves)
            elif self.lens.losses is not None:
                self._trace_lens(core, self.lens, self.waves)
            self._scale_radiance(core)
            weights, of_core = bundle.reshape(-1, 8, BLOCK), core.reshape(-1, 8, BLOCK)
            weights[:, WEIGHT // BLOCK] += of_core[:, WEIGHT // BLOCK]

    def _scale_radiance(self, bundle: Floats) -> None:
        """Multiply weights by the ratio of radiances behind the lens and in front, where media differ."""
        if self._camera.radiance_scale is not None:
            weights, scale = bundle.reshape(-1, RAY // BLOCK, BLOCK)[:, WEIGHT // BLOCK], self._camera.radiance_scale
            weights *= scale[0] if self.waves is None else scale[self.waves[: weights.size]].reshape(weights.shape)
