"""Configuration of the documentation; ``make docs`` builds it without a network."""

import sys
from importlib import import_module
from pathlib import Path

import numpydoc.xref

import skmtgp

sys.path.insert(0, str(Path(__file__).parent))  # for gallery_order and more
from inventories import reachable
from links import icons

project = "skmtgp"
author = "the skmtgp developers"
project_copyright = author
version = release = skmtgp.__version__

extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.doctest",
    "sphinx.ext.intersphinx",
    "sphinx.ext.viewcode",
    "sphinx-mathjax-offline",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
    "lite",
    "pages",
]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
exclude_patterns = ["_build", "images"]
templates_path = ["_templates"]
myst_enable_extensions = ["amsmath", "colon_fence", "dollarmath"]
myst_heading_anchors = 3
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True

autodoc_typehints = "none"
autosummary_generate = True
MODULES = [
    "datasets",
    "exceptions",
    "inspection",
    "kernels",
    "metrics",
    "model_selection",
]
PUBLIC = ["skmtgp", *(f"skmtgp.{name}" for name in [*MODULES, "preprocessing"])]
autosummary_filename_map = {  # the pages that estimators link to
    f"{module}.{name}": name
    for module in PUBLIC
    for name in import_module(module).__all__
}
numpydoc_show_class_members = False
numpydoc_xref_param_type = True
numpydoc_xref_ignore = "all"  # but these; its own links warn without a network
numpydoc.xref.DEFAULT_LINKS.clear()
numpydoc_xref_aliases = {
    "DataFrame": "pandas.DataFrame",
    "Kernel": "sklearn.gaussian_process.kernels.Kernel",
    "RandomState": "numpy.random.RandomState",
    "Series": "pandas.Series",
    "ndarray": "numpy.ndarray",
}
intersphinx_mapping = reachable(
    numpy="https://numpy.org/doc/stable/",
    pandas="https://pandas.pydata.org/docs/",
    python="https://docs.python.org/3/",
    scipy="https://docs.scipy.org/doc/scipy/",
    sklearn="https://scikit-learn.org/stable/",
)
doctest_test_doctest_blocks = ""  # pytest runs those of the docstrings
doctest_global_setup = "import numpy as np; import pandas as pd"
trim_doctest_flags = True

sphinx_gallery_conf = {
    "examples_dirs": "../examples/gallery",
    "gallery_dirs": "auto_examples",
    "copyfile_regex": r"index\.rst",  # the page with the sections
    "within_subsection_order": "gallery_order.position",
    "minigallery_sort_order": "gallery_order.position",
    "doc_module": ("skmtgp",),
    "backreferences_dir": "auto_examples/backreferences",  # "Examples using ..."
    "reference_url": {"skmtgp": None},
    "remove_config_comments": True,  # which choose the pictures of the index
    "min_reported_time": 1,  # seconds
    "image_srcset": ["2x"],  # sharp on phones
    "parallel": 2,
    "reset_modules": (
        "matplotlib",
        "gallery_order.short_warnings",
        "gallery_order.project_colors",
    ),
    "abort_on_example_error": True,
    "capture_repr": (),
    "write_computation_times": False,
    "show_memory": False,
    "show_signature": False,
}

toc_object_entries_show_parents = "hide"
html_theme = "pydata_sphinx_theme"
html_title = f"skmtgp {version}"
html_static_path = ["_static"]
html_css_files = ["skmtgp.css"]
html_favicon = "_static/favicon.svg"
html_context = {"default_mode": "auto"}
html_theme_options = {
    "header_links_before_dropdown": 6,
    "navbar_center": ["navbar-nav", "coming-from"],
    "icon_links": icons(Path(__file__).parents[1] / "pyproject.toml"),
    "navigation_with_keys": False,
    "show_prev_next": True,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
}
html_show_sourcelink = False
html_domain_indices = False
