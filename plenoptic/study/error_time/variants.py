"""Variants of a render: what an error study compares."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.core.values import check_kind, choice, set_field, value, whole, wrong_kind
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.microlens.models import MicrolensModel
from plenoptic.rendering.exposure import Exposure
from plenoptic.rendering.plan.plan import plan
from plenoptic.rendering.plan.stages import Stage, Subject
from plenoptic.rendering.settings import Caustics, RenderSettings, Sampler
from plenoptic.scene.scene import Scene
from plenoptic.study.exposures import expose
from plenoptic.truth.channels import Truth

if TYPE_CHECKING:
    import distributed

_FEW_BOUNCES = 2
"""Depth limit of the default variant with fewer bounces: light that was scattered once more after direct light."""


@value
class Variant:
    """How one way of rendering differs from what `render` does for the camera of a study.

    Parameters
    ----------
    camera : PlenopticCamera, optional
        In place of the study's camera; its sensor must have as many pixels.
    lens : LensModel, optional
        How faithfully the main lens is followed; None: as the camera has it.
    microlenses : MicrolensModel, optional
        How microlenses refract; None: as the camera has it.
    sampler, replicates, max_bounces, caustics, clamp
        As for `render`, with its defaults.

    Raises
    ------
    InvalidValueError
        If `render` would refuse it.

    Examples
    --------
    >>> import plenoptic as pl
    >>> pl.study.Variant(lens=pl.LensModel.THIN, replicates=1)
    Variant(lens=<LensModel.THIN: 1>, replicates=1)
    """

    camera: PlenopticCamera | None = None
    lens: LensModel | None = None
    microlenses: MicrolensModel | None = None
    sampler: Sampler = Sampler.SOBOL
    replicates: int = 2
    max_bounces: int = 8
    caustics: Caustics = Caustics.INCLUDE
    clamp: float | None = None

    def __post_init__(self) -> None:
        if self.camera is not None:
            check_kind(self.camera, "camera", PlenopticCamera, "pl.PlenopticCamera(lens=..., ...)")
        if self.lens is not None:
            set_field(self, "lens", choice(self.lens, LensModel, "lens"))
        if self.microlenses is not None:
            set_field(self, "microlenses", choice(self.microlenses, MicrolensModel, "microlenses"))
        set_field(self, "replicates", whole(self.replicates, "replicates", at_least=1))
        for name, checked in vars(self._settings).items():
            set_field(self, name, checked)

    @property
    def _settings(self) -> RenderSettings:
        return RenderSettings(self.max_bounces, self.caustics, self.clamp, self.sampler)

    def camera_from(self, camera: PlenopticCamera) -> PlenopticCamera:
        """The camera that this variant renders with.

        Parameters
        ----------
        camera : PlenopticCamera
            That of the study.

        Returns
        -------
        PlenopticCamera

        Raises
        ------
        InvalidValueError
            If it has no microlenses whose model could be changed, or a sensor of other size.

        Examples
        --------
        >>> import plenoptic as pl
        >>> camera = pl.PlenopticCamera(lens=pl.load_lens("double-gauss-100mm-f2"),
        ...     sensor=pl.Sensor(shape=(16, 16), pixel_pitch=0.01), stop_to_microlenses=130.0)
        >>> pl.study.Variant(lens=pl.LensModel.THIN).camera_from(camera).lens.model.name
        'THIN'
        """
        chosen = camera if self.camera is None else self.camera
        if chosen.sensor.shape != camera.sensor.shape:
            raise InvalidValueError(
                f"the sensor of a variant's camera has {chosen.sensor.shape} pixels; it must have "
                f"{camera.sensor.shape}, as that of the study's camera"
            )
        if self.lens is not None and chosen.lens.model is not self.lens:
            chosen = dataclasses.replace(chosen, lens=chosen.lens.with_model(self.lens))
        if self.microlenses is not None:
            if chosen.microlenses is None:
                raise InvalidValueError(
                    f"microlenses is {self.microlenses.name}, but the camera has no microlenses; leave it out"
                )
            array = dataclasses.replace(chosen.microlenses, model=self.microlenses)
            chosen = dataclasses.replace(chosen, microlenses=array)
        return chosen

    def render(
        self,
        scene: Scene | None,
        camera: PlenopticCamera,
        *,
        samples: int,
        seed: int,
        region: tuple[slice, slice] | None = None,
        threads: int | None = None,
        client: distributed.Client | None = None,
    ) -> Exposure:
        """Render a scene, or the white image where it is None, in this way and without ground truth.

        Parameters
        ----------
        scene : Scene or None
        camera : PlenopticCamera
            As `camera_from` has made it.
        samples, seed, region, threads, client
            As for `render`.

        Returns
        -------
        Exposure
        """
        subject = Subject(scene, camera, samples, self.replicates, Truth.NONE, self._settings)
        return expose(subject, seed=seed, region=region, threads=threads, client=client)


def default_variants(scene: Scene | None, camera: PlenopticCamera) -> dict[str, Variant]:
    """The variants that make a difference to a scene and a camera, the camera as it is first.

    Parameters
    ----------
    scene : Scene or None
        None: the white image.
    camera : PlenopticCamera

    Returns
    -------
    dict of str to Variant
        Simpler models of lens and microlenses, independent samples, a single replicate; where something scatters,
        fewer bounces; where materials are not all Lambertian, no caustics.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.PlenopticCamera(lens=pl.load_lens("double-gauss-100mm-f2"),
    ...     sensor=pl.Sensor(shape=(16, 16), pixel_pitch=0.01), stop_to_microlenses=130.0)
    >>> list(pl.study.default_variants(None, camera))
    ['EXACT lens', 'PARAXIAL lens', 'THIN lens', 'RANDOM sampler', '1 replicate']
    """
    runs = plan(scene, camera).runs
    model = camera.lens.model
    variants = {f"{model.name} lens": Variant()}
    if model is LensModel.EXACT:
        variants |= {f"{simpler.name} lens": Variant(lens=simpler) for simpler in (LensModel.PARAXIAL, LensModel.THIN)}
    if camera.microlenses is not None and camera.microlenses.is_plate:
        variants["THIN microlenses"] = Variant(microlenses=MicrolensModel.THIN)
    variants |= {"RANDOM sampler": Variant(sampler=Sampler.RANDOM), "1 replicate": Variant(replicates=1)}
    if runs(Stage.SCATTERING):
        variants[f"{_FEW_BOUNCES} bounces"] = Variant(max_bounces=_FEW_BOUNCES)
    if runs(Stage.MATERIALS):
        variants["no caustics"] = Variant(caustics=Caustics.EXCLUDE)
    return variants


def checked_variants(variants: Mapping[str, Variant]) -> dict[str, Variant]:
    """The variants of a study, or an error where there is none or one of them is something else."""
    if not isinstance(variants, Mapping):
        raise wrong_kind(variants, "variants", "mapping of names to variants", '{"thin": Variant(...)}')
    if not variants:
        raise InvalidValueError("variants is empty; give at least one, or leave it out")
    for name, variant in variants.items():
        if not isinstance(name, str) or not name.strip() or "|" in name or "\n" in name:
            raise InvalidValueError(
                f"the name of a variant is {name!r}; it must be a text without bars and line breaks"
            )
        check_kind(variant, f"variants[{name!r}]", Variant, "Variant(replicates=1)")
    return dict(variants)
