"""The version of selenograph. CMakeLists.txt and pyproject.toml read it from this file.

The client works with services of the same major version: api/versions.md.
"""

__version__ = "1.0.0"
