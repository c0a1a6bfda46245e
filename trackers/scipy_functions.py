"""Functions of SciPy from their compiled modules alone: the packages around them take longer to load than NumPy."""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.machinery import EXTENSION_SUFFIXES, ExtensionFileLoader
from importlib.util import find_spec, module_from_spec, spec_from_loader
from pathlib import Path
from typing import Any

from trackers.arrays import Array


def scipy_functions(package: str, module: str, *names: str, needs: str = "") -> tuple[Any, ...]:
    """Return functions of `scipy.PACKAGE` from its compiled module, or from the package where they are not there.

    needs: the compiled module, as `PACKAGE.MODULE`, that this one looks for.
    """
    found = None
    if f"scipy.{package}" not in sys.modules:
        if needs:
            _load(f"scipy.{needs}")
        found = _load(f"scipy.{package}.{module}")
    if not all(hasattr(found, name) for name in names):
        found = import_module(f"scipy.{package}")
    return tuple(getattr(found, name) for name in names)


def _load(name: str) -> Any:
    """Load a compiled module without its packages; None where it is not there."""
    if name in sys.modules:
        return sys.modules[name]
    package = find_spec("scipy")
    roots = (package and package.submodule_search_locations) or ()
    stems = [Path(root).joinpath(*name.split(".")[1:]) for root in roots]
    files = (stem.with_name(stem.name + suffix) for stem in stems for suffix in EXTENSION_SUFFIXES)
    file = next((each for each in files if each.exists()), None)
    spec = file and spec_from_loader(name, ExtensionFileLoader(name, str(file)))
    if not spec or spec.loader is None:
        return None
    sys.modules[name] = module = module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except ImportError:
        del sys.modules[name]
        return None
    return module


(linear_sum_assignment,) = scipy_functions("optimize", "_lsap", "linear_sum_assignment")
ndtr, _gammainccinv = scipy_functions("special", "_special_ufuncs", "ndtr", "gammainccinv")


def chdtri(degrees: Array, share: float) -> Array:
    """Return the values that a χ² of these degrees of freedom exceeds with probability `share`, as `scipy.special.chdtri`."""
    return 2 * _gammainccinv(degrees / 2, share)
