"""Assets: mesh files that others have modelled, found and made into forms."""

from mindstage.assets.assets import Assets, MeshForms
from mindstage.assets.cache import cache_folder

__all__ = ["Assets", "MeshForms", "cache_folder"]
