"""The plenoptic camera: main lens, microlens array and sensor on one axis."""

from __future__ import annotations

import dataclasses

from numpy.typing import ArrayLike

from plenoptic._values import finite, set_field, value, wavelength_in_nm
from plenoptic.camera.pose import Pose
from plenoptic.errors import InvalidValueError
from plenoptic.optics.analysis.focusing import FocusCriterion
from plenoptic.optics.lens import LensStack
from plenoptic.optics.microlenses import ConvexSide, MicrolensArray
from plenoptic.optics.sensor import Sensor


@value
class PlenopticCamera:
    """Main lens, microlens array and sensor, centred on one axis.

    The camera's frame has its origin at the centre of the iris, x to the right, y up, and looks along -z;
    the sensor lies at z > 0.

    Parameters
    ----------
    lens : LensStack
        The main lens.
    sensor : Sensor
    stop_to_microlenses : float
        Distance from the iris to the array's front principal plane in mm; without microlenses, to the sensor.
    microlenses : MicrolensArray, optional
        None is a conventional camera.
    microlenses_to_sensor : float
        Distance from the array's rear principal plane to the sensor in mm; 0 without microlenses.
    pose : Pose, optional
        Where the camera stands in the world; None: the world is the camera's frame.
    wavelength : float
        Vacuum wavelength at which the camera is traced in nm.

    Raises
    ------
    InvalidValueError
        Where the array or the sensor would lie inside the lens or in each other, or a medium of the lens is not
        defined at the wavelength.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.PlenopticCamera(
    ...     lens=pl.load_lens("double-gauss-100mm-f2"),
    ...     microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)),
    ...     sensor=pl.Sensor(shape=(512, 512), pixel_pitch=0.010),
    ...     stop_to_microlenses=123.3,
    ...     microlenses_to_sensor=1.7,
    ... )
    >>> f"{camera.z_sensor:.1f} mm"
    '125.0 mm'
    """

    lens: LensStack
    sensor: Sensor
    stop_to_microlenses: float
    microlenses: MicrolensArray | None = None
    microlenses_to_sensor: float = 0.0
    pose: Pose | None = None
    wavelength: float = 587.6

    def __post_init__(self) -> None:
        for name, kind in (("lens", LensStack), ("sensor", Sensor)):
            if not isinstance(getattr(self, name), kind):
                raise InvalidValueError(f"{name} is {getattr(self, name)!r}; it must be a {kind.__name__}")
        if self.pose is not None and not isinstance(self.pose, Pose):
            raise InvalidValueError(f"pose is {self.pose!r}; it must be a Pose or None, see posed()")
        set_field(self, "wavelength", wavelength_in_nm(self.wavelength))
        self.lens.indices(self.wavelength)
        set_field(self, "stop_to_microlenses", finite(self.stop_to_microlenses, "stop_to_microlenses"))
        set_field(self, "microlenses_to_sensor", finite(self.microlenses_to_sensor, "microlenses_to_sensor"))
        self._check_distances()

    def _check_distances(self) -> None:
        behind = float(self.lens.vertices[-1])
        array = self.microlenses
        if array is None:
            if self.microlenses_to_sensor != 0:
                raise InvalidValueError(
                    f"microlenses_to_sensor is {self.microlenses_to_sensor:g} mm without microlenses; leave it at 0 "
                    "and give the distance from stop to sensor as stop_to_microlenses"
                )
            front = self.stop_to_microlenses
        else:
            if not isinstance(array, MicrolensArray):
                raise InvalidValueError(f"microlenses is {array!r}; it must be a MicrolensArray or None")
            plate = array.thickness / array.index if array.is_plate else 0.0
            towards_scene = plate if array.convex_side is ConvexSide.SENSOR else 0.0
            towards_sensor = plate if array.convex_side is ConvexSide.SCENE else 0.0
            front = self.stop_to_microlenses - towards_scene
            if not self.microlenses_to_sensor > towards_sensor:
                raise InvalidValueError(
                    f"microlenses_to_sensor is {self.microlenses_to_sensor:g} mm; it must be above "
                    f"{towards_sensor:g} mm, where the sensor touches the array"
                )
        if not front > behind:
            raise InvalidValueError(
                f"stop_to_microlenses is {self.stop_to_microlenses:g} mm; the last lens vertex is at z = {behind:g}, "
                f"so it must be above {self.stop_to_microlenses - front + behind:g}"
            )

    @property
    def z_sensor(self) -> float:
        """Position of the sensor in the camera's frame in mm."""
        separation = 0.0 if self.microlenses is None else self.microlenses.principal_separation
        return self.stop_to_microlenses + separation + self.microlenses_to_sensor

    def posed(self, position: ArrayLike, look_at: ArrayLike, up: ArrayLike = (0.0, 1.0, 0.0)) -> PlenopticCamera:
        """The same camera somewhere else.

        Parameters
        ----------
        position : (3,) array
            World position of the centre of the iris in mm.
        look_at : (3,) array
            A world point on the optical axis in front of the camera, in mm.
        up : (3,) array
            World direction that is up in the image.

        Returns
        -------
        PlenopticCamera

        Examples
        --------
        >>> import plenoptic as pl
        >>> camera = pl.PlenopticCamera(lens=pl.load_lens("double-gauss-100mm-f2"),
        ...     sensor=pl.Sensor(shape=(16, 16), pixel_pitch=0.01), stop_to_microlenses=130.0)
        >>> camera.posed(position=(0, 0, 900), look_at=(0, 0, 0)).pose.position.tolist()
        [0.0, 0.0, 900.0]
        """
        return dataclasses.replace(self, pose=Pose.look_at(position, look_at, up))

    def focused_at(self, z: float, *, criterion: FocusCriterion = FocusCriterion.PARAXIAL) -> PlenopticCamera:
        """The same camera with its back moved so that a plane is sharp, by paraxial optics or by the best spot.

        With microlenses of focal length f at b = microlenses_to_sensor, the main lens images the plane onto the
        array itself if b = f, and otherwise onto the plane that the microlenses image onto the sensor: at
        b f / (f - b) behind the array, in front of it where b > f. A conventional camera images it onto its sensor.

        Parameters
        ----------
        z : float
            The plane in the camera's frame in mm, negative: in front of the camera. -inf focuses at infinity.
        criterion : FocusCriterion, optional
            What the main lens images as sharply as it can: rays close to the axis (PARAXIAL), or all rays that pass it
            from the axial point of the plane (RMS_SPOT, GEOMETRIC_SPOT). The lens is followed as its `model` says: a
            THIN one images about one plane, a PARAXIAL one by its cardinal points.

        Returns
        -------
        PlenopticCamera
            microlenses_to_sensor stays, stop_to_microlenses changes.

        Raises
        ------
        InvalidValueError
            Where no position of the back behind the lens is sharp, z is no number, or the lens has LensModel.NONE,
            which images nothing.

        Examples
        --------
        >>> import plenoptic as pl
        >>> camera = pl.PlenopticCamera(lens=pl.load_lens("double-gauss-100mm-f2"),
        ...     sensor=pl.Sensor(shape=(16, 16), pixel_pitch=0.01), stop_to_microlenses=130.0)
        >>> f"{camera.focused_at(z=-404.0).stop_to_microlenses:.3f} mm"
        '134.624 mm'
        >>> least_confused = camera.focused_at(z=-404.0, criterion=pl.FocusCriterion.GEOMETRIC_SPOT)
        >>> f"{least_confused.stop_to_microlenses:.2f} mm"
        '134.86 mm'
        """
        from plenoptic.camera.focus import focused_stop_to_microlenses

        moved = focused_stop_to_microlenses(self, z, criterion)
        return dataclasses.replace(self, stop_to_microlenses=moved)
