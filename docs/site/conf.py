# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Configuration of Sphinx for the site of the docs: `make site`."""

project = 'checkweigher'
author = 'Checkweigher maintainers'
copyright = '2026, Checkweigher maintainers'  # noqa: A001

extensions = ['myst_parser', 'sphinx.ext.autodoc', 'numpydoc']
root_doc = 'index'
exclude_patterns = ['**/QUALITY_DECLARATION.md']

html_theme = 'pydata_sphinx_theme'
html_title = 'checkweigher'
html_static_path = ['static']
html_css_files = ['site.css']
html_theme_options = {
    'collapse_navigation': True,  # otherwise each page has the names of all modules
    'navigation_with_keys': False,
    'show_toc_level': 2,
}
html_show_sourcelink = False
html_copy_source = False

myst_heading_anchors = 4
myst_links_external_new_tab = False
# Links to files that are no pages, such as LICENSE, are copied beside the page.
suppress_warnings = ['myst.header', 'myst.xref_missing', 'autosectionlabel.*']
highlight_language = 'none'

numpydoc_show_class_members = False
autodoc_default_options = {'members': True, 'show-inheritance': True}
autodoc_typehints = 'signature'
