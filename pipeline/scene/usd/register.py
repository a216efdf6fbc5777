"""Registration of our schemas and our library of stages with USD."""

import os

from pxr import Ar, Plug, Usd

from pipeline.errors import EnvironmentFault
from pipeline.folders import share

PLUGIN_NAME = "plenScene"


class SchemaNotLoaded(EnvironmentFault):
    """The schemas were registered too late: USD has already built its schema registry."""


def plugin_path() -> str:
    """Folder to put on PXR_PLUGINPATH_NAME, so that any USD program knows the plenScene schemas."""
    return share("schemas").as_posix()


def library_path() -> str:
    """Folder of the shipped stages, to put on PXR_AR_DEFAULT_SEARCH_PATH for other USD programs."""
    return share("stages").as_posix()


def register() -> None:
    """Register the schemas and the search path of the library.

    Raises
    ------
    SchemaNotLoaded
        A stage was opened before, so USD would silently ignore the schemas.
    """
    registry = Plug.Registry()
    # USD may have found it already through PXR_PLUGINPATH_NAME.
    if registry.GetPluginWithName(PLUGIN_NAME) is None:
        registry.RegisterPlugins(plugin_path())
    # This call builds USD's schema registry now, in the importing thread: built first in another thread it may hang,
    # and without the call a late import would only be noticed as prims without a type.
    if Usd.SchemaRegistry().FindConcretePrimDefinition("PlenDataset") is None:
        raise SchemaNotLoaded(
            "USD ignores the plenScene schemas, because it had opened a stage before they were registered",
            hint=f"import pipeline.scene before opening a stage, or set PXR_PLUGINPATH_NAME={plugin_path()}",
        )
    # Setting the path replaces that of the environment variable, so it is repeated here.
    theirs = [folder for folder in os.environ.get("PXR_AR_DEFAULT_SEARCH_PATH", "").split(os.pathsep) if folder]
    Ar.DefaultResolver.SetDefaultSearchPath([library_path(), *theirs])
