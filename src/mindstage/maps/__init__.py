"""Semantic maps as files: dialects, conventions, reading of files, robot descriptions, and writing of maps.

A module is imported when one of its names is first used: reading a map needs no writer of maps.
"""

from typing import TYPE_CHECKING

from mindstage.lazy_names import lazy_names

if TYPE_CHECKING:
    from mindstage.maps.dialects.conventions import (
        Assumption,
        Handedness,
        LengthUnit,
        QuaternionOrder,
        SizeFrame,
        UnitConventions,
        UnstatedMobility,
    )
    from mindstage.maps.dialects.map_statistics import MapStatistics
    from mindstage.maps.io.files import bundled_kitchen, bundled_ontology
    from mindstage.maps.io.formats import MapFormat
    from mindstage.maps.io.graph_diff import SourceMapView, lost_statements
    from mindstage.maps.io.write import MapDialect, save_map, write_map

__all__ = [
    "Assumption",
    "Handedness",
    "LengthUnit",
    "MapDialect",
    "MapFormat",
    "MapStatistics",
    "QuaternionOrder",
    "SizeFrame",
    "SourceMapView",
    "UnitConventions",
    "UnstatedMobility",
    "bundled_kitchen",
    "bundled_ontology",
    "lost_statements",
    "save_map",
    "write_map",
]

_MODULES = {
    "Assumption": "mindstage.maps.dialects.conventions",
    "Handedness": "mindstage.maps.dialects.conventions",
    "LengthUnit": "mindstage.maps.dialects.conventions",
    "MapDialect": "mindstage.maps.io.write",
    "MapFormat": "mindstage.maps.io.formats",
    "MapStatistics": "mindstage.maps.dialects.map_statistics",
    "QuaternionOrder": "mindstage.maps.dialects.conventions",
    "SizeFrame": "mindstage.maps.dialects.conventions",
    "SourceMapView": "mindstage.maps.io.graph_diff",
    "UnitConventions": "mindstage.maps.dialects.conventions",
    "UnstatedMobility": "mindstage.maps.dialects.conventions",
    "bundled_kitchen": "mindstage.maps.io.files",
    "bundled_ontology": "mindstage.maps.io.files",
    "lost_statements": "mindstage.maps.io.graph_diff",
    "save_map": "mindstage.maps.io.write",
    "write_map": "mindstage.maps.io.write",
}


__getattr__, __dir__ = lazy_names(__name__, _MODULES)
