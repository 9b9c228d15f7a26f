"""Variants of a render, which an error study compares."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from plenoptic.camera.camera import PlenopticCamera
from plenoptic.core.values import check_kind, choice, set_field, value, whole, wrong_kind
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.models import LensModel
from plenoptic.optics.microlens.models import MicrolensModel
from plenoptic.rendering.plan.plan import plan
from plenoptic.rendering.plan.stages import Stage
from plenoptic.rendering.settings import Caustics, RenderSettings, Sampler
from plenoptic.scene.scene import Scene

_FEW_BOUNCES = 2
"""Depth limit of the default variant with fewer bounces: light that was scattered once more after direct light."""


@value
class Variant:
    """One way of rendering, by its differences from the defaults of `render` and from the camera of a study.

    Parameters
    ----------
    camera : PlenopticCamera, optional
        In place of the study's camera; its sensor must have as many pixels.
    lens : LensModel, optional
        Model of the main lens; None: that of the camera.
    microlenses : MicrolensModel, optional
        Model of the microlenses, another one without their coating; None: that of the camera.
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
        for name, checked in vars(self.settings).items():
            set_field(self, name, checked)

    @property
    def settings(self) -> RenderSettings:
        """Settings of its renders."""
        return RenderSettings(self.max_bounces, self.caustics, self.clamp, self.sampler)

    def camera_from(self, camera: PlenopticCamera) -> PlenopticCamera:
        """The camera of its renders, from that of the study.

        Raises
        ------
        InvalidValueError
            If the camera has no microlenses whose model could be changed, or a sensor of another size.
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
            array, model = chosen.microlenses, self.microlenses
            coating = array.coating if array.model is model else None
            array = dataclasses.replace(array, model=model, coating=coating)
            chosen = dataclasses.replace(chosen, microlenses=array)
        return chosen


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
        Simpler models of lens and microlenses, independent samples, a single replicate; fewer bounces if surfaces
        scatter light; no caustics if materials are not all Lambertian.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.camera.example_camera(pl.CameraKind.CONVENTIONAL, shape=(16, 16))
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
    """The variants of a study, or an error if there is none or one of them is of another kind."""
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
