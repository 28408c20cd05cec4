"""Assets: mesh files that others have modelled, found and made into forms."""

from mindstage.assets.assets import Assets, MeshForms

__all__ = ["Assets", "MeshForms"]
