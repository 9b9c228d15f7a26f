"""The site: `python -m sphinx -W docs build/site`. PLENOPTIC_EXAMPLE_SIZE=small makes its examples small."""

import re
import sys
from pathlib import Path

DOCS = Path(__file__).parent
sys.path.insert(0, str(DOCS / "_site"))

import galleries  # noqa: E402
import numpydoc.xref  # noqa: E402
import tqdm.std  # noqa: E402
from api_pages import write_pages  # noqa: E402
from links import CLASSES  # noqa: E402

import plenoptic  # noqa: E402

project = "plenoptic"
author = copyright = "the plenoptic developers"
release = version = plenoptic.__version__

extensions = [
    "sphinx.ext.autodoc",
    "numpydoc",
    "myst_parser",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
    "links",
    "mathml",
    "broken",
]
exclude_patterns = ["_site"]
default_role = "py:obj"
suppress_warnings = ["config.cache"]
linkcheck_ignore = [r"https?://"]

autodoc_typehints = "none"
autodoc_preserve_defaults = True
numpydoc_show_class_members = False
numpydoc_xref_param_type = True
numpydoc_xref_ignore = "all"
numpydoc_xref_aliases = CLASSES
numpydoc.xref.DEFAULT_LINKS.clear()  # of Python and NumPy: those pages are on other hosts
myst_heading_anchors = 3
myst_enable_extensions = ["colon_fence", "deflist"]

tqdm.std.tqdm.status_printer = staticmethod(lambda file: lambda text: None)  # pages show no progress bars
_galleries = galleries.staged()
sphinx_gallery_conf = {
    "examples_dirs": [str(folder) for folder in _galleries.values()],
    "gallery_dirs": list(_galleries),
    "filename_pattern": r".*\.py",
    "within_subsection_order": galleries.order,
    "backreferences_dir": "backreferences",
    "doc_module": ("plenoptic",),
    "reference_url": {"plenoptic": None},
    "abort_on_example_error": False,
    "remove_config_comments": True,
    "show_memory": False,
    "write_computation_times": False,  # that page loads scripts from other hosts
    "show_signature": False,
    "matplotlib_animations": True,
}

html_theme = "pydata_sphinx_theme"
html_math_renderer = "mathml"
html_title = f"plenoptic {version}"
html_static_path = ["_site/static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_theme_options = {
    "header_links_before_dropdown": 7,
    "navbar_persistent": [],
    "navbar_end": ["search-button-field", "theme-switcher"],
    "navigation_with_keys": False,
    "show_nav_level": 1,
    "footer_start": ["copyright"],
    "footer_end": [],
    "secondary_sidebar_items": ["page-toc", "sg_download_links"],
}
html_sidebars = {"index": []}
html_context = {"default_mode": "auto"}


def plain_defaults(app, what, name, obj, options, signature, returned):
    """`Lattice.HEXAGONAL`, as users type it, for `<Lattice.HEXAGONAL: 0>`."""
    return re.sub(r"<(\w+(?:\.\w+)?)(?:\|[\w|]+)?: -?\d+>", r"\1", signature or "") or None, None


def skipped(app, what, name, obj, skip, options):
    """Fields of tuples, which the class describes, and what enumerations inherit from int."""
    return True if type(obj).__name__ == "_tuplegetter" else None


def setup(app):
    write_pages(DOCS / "api")
    app.connect("autodoc-process-signature", plain_defaults)
    app.connect("autodoc-skip-member", skipped)
