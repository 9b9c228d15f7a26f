"""Paths from the sensor to behind the lens: the stages that a camera needs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from plenoptic.camera.dust import fill_dimmed_at_lens
from plenoptic.camera.record import CameraRecord
from plenoptic.camera.sampling.kernels import paths
from plenoptic.camera.sampling.pixel_regions import feeding_regions
from plenoptic.camera.sampling.record import Batch, Bends, FedPixels
from plenoptic.camera.sampling.through_array import fill_dimmed_before_array, fill_through_array
from plenoptic.core.kernels.ray_blocks import BLOCK, RAY, WEIGHT, X, Y
from plenoptic.core.values import Floats
from plenoptic.optics.lens.kernels.trace import fill_traced
from plenoptic.optics.microlens.dust import BlemishSite
from plenoptic.optics.microlens.kernels import to_lens

_GUIDES = 1024
"""Places in a table of cumulative probabilities at which looking begins; see `fill_waves`."""


class CameraPaths:
    """Bundles of paths of some pixels, of at most `most` paths; the arrays are used again for each bundle."""

    def __init__(self, camera: CameraRecord, fed: FedPixels, batch: Batch, most: int) -> None:
        blocks = -(-most // BLOCK)
        self._camera, self._fed, self._batch = camera, fed, batch
        self._blocks = np.empty(blocks * RAY)
        self.sure = np.empty(blocks * RAY) if fed.certain else None
        """What surely passes the lens, aimed; None where that is not known."""
        self.own = camera.own(blocks * BLOCK)
        """What is individual about the paths' microlenses; None where these do not differ."""
        self.waves: NDArray[np.int64] | None = None
        """Numbers of the paths' wavelengths; None where all have the camera's."""
        self.lens = camera.lens
        """What paths are traced through."""
        if camera.colour is not None and camera.dispersed is not None:
            self.waves, self.lens = np.empty(blocks * BLOCK, dtype=np.int64), camera.dispersed
            self._guide = np.searchsorted(camera.colour.cdf, np.arange(_GUIDES) / _GUIDES, side="right")
        self._far = None if fed.around is None else np.empty(most, dtype=np.int64)
        self.spots = None if fed.spread is None else np.empty(most, dtype=np.int64)
        """Rows of the `SpreadTable`; None where light is not shared."""
        bent = fed.around is not None or fed.spread is not None
        self._bends = Bends(self._far, self.spots, self.waves) if bent else None

    def started(self, start: int, n: int) -> Floats:
        """Bundle of the paths start ... start + n - 1: points on their pixels, aimed into the aperture regions;
        wavelengths.
        """
        bundle, colour = self._blocks[: -(-n // BLOCK) * RAY], self._camera.colour
        core = None if self.sure is None else self.sure[: bundle.size]
        if colour is not None and self.waves is not None:
            paths.fill_waves(self.waves, start, n, self._batch, self._fed.number, colour.cdf, self._guide)
        away = paths.fill_camera_samples(bundle, core, self.own, self._bends, start, n, self._batch, self._fed)
        if self._far is not None:
            self._start_far(bundle, self._far[:away])
        return bundle

    def _start_far(self, bundle: Floats, far: NDArray[np.int64]) -> None:
        """The few paths whose light is deflected from far away; bounds give the aperture regions of their points."""
        fields = bundle.reshape(-1, RAY // BLOCK, BLOCK)
        starts = np.stack([fields[far // BLOCK, row // BLOCK, far % BLOCK] for row in (X, Y)], axis=-1)
        paths.fill_far_samples(bundle, self.own, far, feeding_regions(self._camera._replace(exact=False), starts))

    def fill_through_array(self, bundle: Floats) -> None:
        """From the sensor to behind the array."""
        sensor = self._camera.sensor
        fill_dimmed_before_array(bundle, sensor.plane, sensor.response, self._camera.dust)
        fill_through_array(bundle, self.own, self._camera, self.waves)
        if self.sure is not None:
            core = self.sure[: bundle.size]
            fill_dimmed_before_array(core, sensor.plane, sensor.response, ())
            to_lens.fill_weights(core, sensor.plane)

    def fill_bent_at_iris(self, bundle: Floats, start: int, n: int) -> None:
        """Bend the rays of paths start ... start + n - 1 behind the lens, where the camera asks for it."""
        if self._camera.iris is not None:
            paths.fill_bent_at_iris(bundle, start, n, self._batch, self._fed.number, self.waves, self._camera.iris)

    def fill_through_lens(self, bundle: Floats) -> None:
        """Through the lens and the dust on it."""
        fill_dimmed_at_lens(bundle, self._camera.dust, BlemishSite.LENS_REAR)
        fill_traced(bundle, self.lens, self.waves)
        fill_dimmed_at_lens(bundle, self._camera.dust, BlemishSite.LENS_FRONT)
        if self.sure is not None:
            weights, core = bundle.reshape(-1, 8, BLOCK), self.sure[: bundle.size].reshape(-1, 8, BLOCK)
            weights[:, WEIGHT // BLOCK] += core[:, WEIGHT // BLOCK]
