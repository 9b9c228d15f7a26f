"""What is compiled of the scene that was rendered last, for the next call with the same one."""

from __future__ import annotations

from plenoptic.core.last_made import LastMade
from plenoptic.scene.compile import SceneRecord
from plenoptic.scene.geometry.accel import Intersector, build_intersector
from plenoptic.scene.scene import Scene


class PreparedScene:
    """A scene as a record, and what finds its triangles.

    There is no lock, for which a process that is forked off meanwhile would wait for ever: two threads may both build.
    """

    def __init__(self, record: SceneRecord) -> None:
        self.record = record
        self._built: tuple[Intersector | None] | None = None

    @property
    def intersector(self) -> Intersector | None:
        """Built when it is asked for; None where there are no triangles to meet."""
        if self._built is None:
            geometry = self.record.geometry
            self._built = (None if geometry is None else build_intersector(geometry, self.record.instances),)
        return self._built[0]


def prepared_scene(scene: Scene) -> PreparedScene:
    """Compile a scene, unless it is the very one that was compiled last and still exists: scenes do not change."""
    return _last(scene)


_last: LastMade[Scene, PreparedScene] = LastMade(lambda scene: PreparedScene(scene.tables()))
"""Of one scene only: trees take as much memory as scenes do."""
