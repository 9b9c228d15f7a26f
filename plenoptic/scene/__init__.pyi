from .file_cameras import View as View
from .files.load import FileContents as FileContents
from .files.load import load_file as load_file
from .files.load import load_meshes as load_meshes
from .geometry.instance import Instances as Instances
from .geometry.mesh import Mesh as Mesh
from .points import Points as Points
from .scene import Scene as Scene
