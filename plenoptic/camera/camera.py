"""The plenoptic camera: main lens, microlens array and sensor."""

from __future__ import annotations

import dataclasses
import enum
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from plenoptic.camera.assembly import check_assembly
from plenoptic.camera.diffraction import Diffraction, check_diffraction
from plenoptic.camera.dust import check_blemishes
from plenoptic.camera.shutter import Shutter
from plenoptic.camera.units import metres_hint
from plenoptic.core.color.spectra import Sensitivity
from plenoptic.core.display import draw, picture_of
from plenoptic.core.motions.pose import Pose as Pose  # public there too
from plenoptic.core.values import SMALLEST_LENGTH, choice, coordinate, set_field, value, wavelength_in_nm
from plenoptic.errors import InvalidValueError
from plenoptic.optics.lens.models import FocusCriterion
from plenoptic.optics.lens.placement import Placement, normalised_placement, rotation_about_axes
from plenoptic.optics.lens.stack import LensStack
from plenoptic.optics.microlens.array import MicrolensArray
from plenoptic.optics.microlens.dust import Blemishes
from plenoptic.optics.sensor.sensor import Sensor

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from plenoptic.camera.points.projection import Projection
    from plenoptic.camera.points.white_fit import CameraFit
    from plenoptic.camera.report.report import CameraReport
    from plenoptic.core.rays import Frustum
    from plenoptic.rendering.exposure import Exposure
    from plenoptic.scene.scene import Scene


class CameraPart(enum.IntEnum):
    """Parts of a camera that can be displaced from the design.

    Examples
    --------
    >>> import plenoptic as pl
    >>> [part.name for part in pl.CameraPart]
    ['LENS', 'MICROLENSES', 'SENSOR']
    """

    LENS = 0
    MICROLENSES = 1
    SENSOR = 2


@value
class PlenopticCamera:
    """Main lens, microlens array and sensor, designed to stand centred on one axis.

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
        None for a conventional camera.
    microlenses_to_sensor : float
        Distance from the array's rear principal plane to the sensor in mm; 0 without microlenses.
    pose : Pose, optional
        Position and orientation of the camera in the world; None: the camera's frame is the world.
    wavelength : float
        Vacuum wavelength at which the camera is traced in nm.
    lens_placement, microlenses_placement, sensor_placement : Placement, optional
        Displacement of each part from its design: decentre, rotation about the axis, tilt. The lens turns about the
        centre of its iris, the array about the centre of its front principal plane, the sensor about its centre.
        None: as designed.
    blemishes : tuple of Blemishes
        Dust and scratches on the parts; a tuple, or one object.
    sensitivity : Sensitivity, optional
        Spectral sensitivity of the sensor's channels, traced wavelength by wavelength; None: all light has
        `wavelength`, and the channels are those of the scene.
    shutter : Shutter, optional
        Exposure times of the rows, for motion during the exposure; None: an instant.
    diffraction : Diffraction, optional
        Diffraction at the openings of microlenses, and optionally at the iris; None: geometrical optics, at no cost.

    Raises
    ------
    InvalidValueError
        If the array or the sensor would lie inside the lens or in each other, or a medium of the lens is not defined at
        the wavelength.

    Examples
    --------
    >>> import plenoptic as pl
    >>> camera = pl.PlenopticCamera(lens=pl.load_lens("double-gauss-100mm-f2"),
    ...     microlenses=pl.MicrolensArray(pitch=0.217, focal_lengths=(2.0,)),
    ...     sensor=pl.Sensor(shape=(512, 512), pixel_pitch=0.01), stop_to_microlenses=123.3, microlenses_to_sensor=1.7)
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
    lens_placement: Placement | None = dataclasses.field(default=None, kw_only=True)
    microlenses_placement: Placement | None = dataclasses.field(default=None, kw_only=True)
    sensor_placement: Placement | None = dataclasses.field(default=None, kw_only=True)
    blemishes: tuple[Blemishes, ...] = dataclasses.field(default=(), kw_only=True)
    sensitivity: Sensitivity | None = dataclasses.field(default=None, kw_only=True)
    shutter: Shutter | None = dataclasses.field(default=None, kw_only=True)
    diffraction: Diffraction | None = dataclasses.field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        parts = {"lens": LensStack, "sensor": Sensor}
        absent = {"microlenses": MicrolensArray, "pose": Pose, "sensitivity": Sensitivity}
        absent |= {"shutter": Shutter, "diffraction": Diffraction}
        for name, kind in (parts | absent).items():
            argument, other = getattr(self, name), "" if name in parts else " or None"
            if not isinstance(argument, kind) and not (other and argument is None):
                raise InvalidValueError(f"{name} is {argument!r}; it must be a {kind.__name__}{other}")
        set_field(self, "wavelength", wavelength_in_nm(self.wavelength))
        wavelengths = () if self.sensitivity is None else self.sensitivity.wavelength_range
        for wavelength in (self.wavelength, *wavelengths):
            self.lens.indices(wavelength)
        for name in ("stop_to_microlenses", "microlenses_to_sensor"):
            set_field(self, name, coordinate(getattr(self, name), name))
        for name in ("lens_placement", "microlenses_placement", "sensor_placement"):
            set_field(self, name, normalised_placement(getattr(self, name)))
        if self.microlenses is None and self.microlenses_placement is not None:
            raise InvalidValueError("microlenses_placement is given without microlenses; leave it out")
        is_sequence = isinstance(self.blemishes, tuple | list)
        set_field(self, "blemishes", tuple(self.blemishes) if is_sequence else (self.blemishes,))
        check_blemishes(self)
        check_diffraction(self)
        self._check_distances()
        check_assembly(self)

    def _check_distances(self) -> None:
        array, front, z_last = self.microlenses, self.stop_to_microlenses, float(self.lens.vertices[-1])
        if array is None:
            if self.microlenses_to_sensor != 0:
                raise InvalidValueError(
                    f"microlenses_to_sensor is {self.microlenses_to_sensor:g} mm without microlenses; leave it at 0 "
                    "and give the distance from stop to sensor as stop_to_microlenses"
                )
        else:
            depths = array.model.refraction.depths(array)
            front -= depths.front
            clearance = max(depths.rear, SMALLEST_LENGTH)
            if not self.microlenses_to_sensor > clearance:
                raise InvalidValueError(
                    f"microlenses_to_sensor is {self.microlenses_to_sensor:g} mm; it must be above "
                    f"{clearance:g} mm, where the sensor touches the array"
                )
        if not front > z_last:
            least = self.stop_to_microlenses - front + z_last
            raise InvalidValueError(
                f"stop_to_microlenses is {self.stop_to_microlenses:g} mm; the last lens vertex is at z = {z_last:g}, "
                f"so it must be above {least:g}{metres_hint(self.stop_to_microlenses, least)}"
            )

    @property
    def design(self) -> PlenopticCamera:
        """The same camera as designed: without placements, imperfections and blemishes."""
        array = self.microlenses
        return dataclasses.replace(
            self,
            microlenses=array if array is None else dataclasses.replace(array, imperfections=None),
            lens_placement=None,
            microlenses_placement=None,
            sensor_placement=None,
            blemishes=(),
        )

    def moved(
        self,
        part: CameraPart,
        *,
        shift: tuple[float, float, float] = (0.0, 0.0, 0.0),
        tilt: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> PlenopticCamera:
        """The same camera with one part displaced further: decentred, tilted or rotated about the axis.

        Parameters
        ----------
        part : CameraPart
            LENS, MICROLENSES or SENSOR.
        shift : (float, float, float), optional
            Displacement in mm along the axes of the camera.
        tilt : (float, float, float), optional
            Angles in radians about x, then y, then z, through the part's own centre: of the iris, of the array's front
            principal plane, of the sensor.

        Returns
        -------
        PlenopticCamera
            `design` does not change; displacements add up. InvalidValueError if the part is missing or touches another.

        Examples
        --------
        >>> import math, plenoptic as pl
        >>> camera = pl.camera.example_camera(shape=(64, 64))
        >>> tilted = camera.moved(pl.CameraPart.SENSOR, shift=(0.01, 0.0, 0.0), tilt=(math.radians(1.0), 0.0, 0.0))
        >>> tilted.sensor_placement.shift.tolist(), tilted.design == camera
        ([0.01, 0.0, 0.0], True)
        """
        name = f"{choice(part, CameraPart, 'part').name.lower()}_placement"
        before: Any = getattr(self, name) or Placement()
        moved = Placement(before.shift + Placement(shift=shift).shift, rotation_about_axes(tilt) @ before.rotation)
        return dataclasses.replace(self, **dict[str, Any]({name: moved}))

    @property
    def z_sensor(self) -> float:
        """Position of the sensor's centre in the camera's frame in mm, as designed."""
        separation = 0.0 if self.microlenses is None else self.microlenses.principal_separation
        return self.stop_to_microlenses + separation + self.microlenses_to_sensor

    def fitted_to(self, white: Exposure) -> CameraFit:
        """The camera with its microlens array shifted, turned and scaled as a white image shows it.

        Parameters
        ----------
        white : Exposure
            White image of the whole sensor or of a region, also a photographed one: `Exposure(image, white=True)`.

        Returns
        -------
        CameraFit
            The camera, the three changes, and the displacement that remains. Another distance from array to sensor
            or pupil looks like another pitch. Of displacements by steps of the lattice it is the least one that puts
            microlenses of each focal length where the image shows them; a warning says if it does not show them.

        Raises
        ------
        InvalidValueError
            Without a lattice of microlenses that the image shows.

        Examples
        --------
        >>> import plenoptic as pl
        >>> camera = pl.camera.example_camera(pl.CameraKind.PLENOPTIC_1, shape=(160, 160))
        >>> built = camera.moved(pl.CameraPart.MICROLENSES, shift=(0.02, -0.01, 0.0))
        >>> fit = camera.fitted_to(pl.render_white(built, samples=16, progress=False))
        >>> fit.shift.round(3).tolist(), fit.camera.microlenses_placement.shift.round(3).tolist()
        ([0.02, -0.01], [0.02, -0.01, 0.0])
        """
        from plenoptic.camera.points.white_fit import fit_camera  # knows this class

        return fit_camera(self, white)

    def posed(self, position: ArrayLike, look_at: ArrayLike, up: ArrayLike = (0.0, 1.0, 0.0)) -> PlenopticCamera:
        """The same camera with another pose.

        Parameters
        ----------
        position : (3,) array
            World position of the centre of the iris in mm.
        look_at : (3,) array
            A world point on the optical axis in front of the camera, in mm.
        up : (3,) array
            World direction that is up in the image.

        Examples
        --------
        >>> import plenoptic as pl
        >>> camera = pl.camera.example_camera(pl.CameraKind.CONVENTIONAL, shape=(16, 16))
        >>> camera.posed(position=(0, 0, 900), look_at=(0, 0, 0)).pose.position.tolist()
        [0.0, 0.0, 900.0]
        """
        return dataclasses.replace(self, pose=Pose.look_at(position, look_at, up))

    def project(self, points: ArrayLike, scene: Scene | None = None, *, progress: bool = True) -> Projection:
        """Project world points onto the sensor, through every microlens that images them; see `project`.

        Parameters
        ----------
        points : (n, 3) array
            World positions in mm.
        scene : Scene, optional
            Occluders; None: nothing hides the points.
        progress : bool, optional
            See `project`.
        """
        from plenoptic.camera.points.projection import project  # knows this class

        return project(self, points, scene=scene, progress=progress)

    @property
    def frustum(self) -> Frustum:
        """Field of view in the world: rays from the corners of the sensor, for pictures of scenes.

        (4, 3) arrays in the world, mm; `Frustum` has an example.
        """
        from plenoptic.camera.report.layout import camera_frustum  # knows this class

        return camera_frustum(self)

    def tiles(self, rows: int, columns: int) -> tuple[tuple[slice, slice], ...]:
        """Divide the sensor into rows x columns regions, row by row, for renders on several machines.

        Their edges are multiples of 8 pixels. Render each as `region=`, and pass all exposures to `Exposure.merged`.
        """
        from plenoptic.camera.checks import sensor_tiles  # knows this class

        return sensor_tiles(self.sensor.shape, rows, columns)

    def layout(self, *, figure: Figure | None = None) -> Figure:
        """Draw a section of the camera, to scale, with the rays of one pixel through its microlens.

        Parameters
        ----------
        figure : matplotlib.figure.Figure, optional
            Figure to draw in; default: a new one.

        Returns
        -------
        matplotlib.figure.Figure
            Section in the lens's frame, as built. A second axes shows the microlenses around those rays and the pixels
            at another scale; `pl.plots.plot_camera` compares f-numbers there.

        Examples
        --------
        >>> import plenoptic as pl
        >>> camera = pl.camera.example_camera()
        >>> [ax.get_xlabel() for ax in camera.layout().axes]
        ['z / mm (scene on the left, iris at 0)', 'distance behind the array / mm']
        """
        drawn: Figure = draw(self, figure)
        return drawn

    _repr_html_ = picture_of

    def report(self) -> CameraReport:
        """First-order properties of the camera, and warnings of common pitfalls; see `camera_report`.

        Examples
        --------
        >>> import plenoptic as pl
        >>> camera = pl.camera.example_camera()
        >>> camera.report().kind.name
        'GALILEAN'
        """
        from plenoptic.camera.report.report import camera_report  # knows this class

        return camera_report(self)

    def focused_at(
        self, z: float, *, criterion: FocusCriterion = FocusCriterion.PARAXIAL, microlens_type: int | None = None
    ) -> PlenopticCamera:
        """The same camera with its back moved so that a plane is in focus, by paraxial optics or by the best spot.

        With microlenses of focal length f at b = microlenses_to_sensor, the main lens images the plane onto the
        array itself if b = f, and otherwise onto the plane that the microlenses image onto the sensor: at
        b f / (f - b) behind the array, in front of it where b > f. A conventional camera images it onto its sensor.

        Parameters
        ----------
        z : float
            The plane in the camera's frame in mm, negative: in front of the camera. -inf focuses at infinity.
        criterion : FocusCriterion, optional
            Best focus of the main lens: of paraxial rays (PARAXIAL), or of all rays that pass it from the axial point
            of the plane (RMS_SPOT, GEOMETRIC_SPOT). The lens is traced by its `model`: a THIN one has a single
            principal plane, a PARAXIAL one its cardinal points.
        microlens_type : int, optional
            Type of microlens to focus, if focal lengths differ: a row of `focal_lengths`.

        Returns
        -------
        PlenopticCamera
            Only stop_to_microlenses changes.

        Raises
        ------
        InvalidValueError
            If no position of the back behind the lens is in focus, z is no number, the lens has LensModel.NONE, which
            forms no image, or one of several types is not named.

        Examples
        --------
        >>> import plenoptic as pl
        >>> camera = pl.camera.example_camera(pl.CameraKind.CONVENTIONAL, shape=(16, 16))
        >>> f"{camera.focused_at(z=-404.0).stop_to_microlenses:.3f} mm"
        '134.624 mm'
        >>> least_confused = camera.focused_at(z=-404.0, criterion=pl.FocusCriterion.GEOMETRIC_SPOT)
        >>> f"{least_confused.stop_to_microlenses:.2f} mm"
        '134.53 mm'
        """
        from plenoptic.camera.gaussian import focused_stop_to_microlenses  # knows this class

        moved = focused_stop_to_microlenses(self, z, criterion, microlens_type)
        return dataclasses.replace(self, stop_to_microlenses=moved)
