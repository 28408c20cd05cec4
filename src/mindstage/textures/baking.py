"""Bakes textures to images, once for each version of the code that computes them.

A recipe computes three fields on a periodic grid: the shade (linear light, relative), the height of the surface and
the relative roughness. Baking scales the shade so that its mean is neutral and it is nowhere above 1, since it
multiplies the color of the material, and derives the normals from the height at the metric size of the texture.
"""

from __future__ import annotations

import io
from collections import defaultdict
from dataclasses import dataclass
from functools import cache
from hashlib import blake2b
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING

from mindstage.files import atomic_write, cache_dir
from mindstage.textures.catalog import TextureInfo, texture_info

if TYPE_CHECKING:
    from numpy import uint8
    from numpy.typing import NDArray

    from mindstage.textures.noise import Array, Surface

__all__ = ["TextureSet", "content_version", "texture_levels", "texture_set"]

_PIXELS = 512
_FOLDER = "textures"
_LEVEL_PIXELS = 256
"""Width and height of the largest of the stored levels: pictures of rooms need no larger ones."""
_BRIGHTEST = 0.995
"""Quantile of the shade that becomes white; brighter pixels are clipped."""


@dataclass(frozen=True, slots=True, eq=False)
class TextureSet:
    """The images of a texture. They repeat in both directions without a seam."""

    name: str
    color: NDArray[uint8]
    """h x w x 3, sRGB; multiplied by the color of the material. Its mean is gray, near white."""
    roughness: NDArray[uint8]
    """h x w, linear; multiplied by the roughness of the material."""
    normal: NDArray[uint8]
    """h x w x 3, tangent space, x to the right and y upwards, as in glTF: 255 is 1, 0 is -1."""
    size: tuple[float, float]
    """Width and height of one repeat [m]."""

    def mean_shade(self) -> float:
        """The mean of the color image in linear light: how much it darkens a material."""
        import numpy as np

        return float(np.mean(_linear(self.color.astype(np.float32) / 255.0)))


@cache
def content_version() -> str:
    """A digest of the code that computes textures: images in caches are valid for one version."""
    digest = blake2b(digest_size=8)
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()


_baked: dict[str, TextureSet] = {}
_locks: defaultdict[str, Lock] = defaultdict(Lock)
"""One for each texture, so that several are baked at a time."""


def texture_set(name: str) -> TextureSet:
    """The images of a texture: from memory, else from the cache directory, else computed (about 0.2 s).

    Raises:
        TextureNotFoundError: there is no texture of that name.
    """
    info = texture_info(name)
    with _locks[name]:
        if name not in _baked:
            _baked[name] = _load(info) or _bake_and_store(info)
        return _baked[name]


def texture_levels(name: str, pixels: int) -> list[NDArray[uint8]]:
    """The images of a texture in decreasing resolutions, as graphics hardware reads them.

    Args:
        name: the name of the texture.
        pixels: width and height of the first level; the least power of two that is not below, at most that of the
            texture.

    Returns:
        For each level, 2 x h x w x 4: sRGB; and x and y of the normal, roughness. The fourth component is 255.

    Raises:
        TextureNotFoundError: there is no texture of that name.
    """
    import numpy as np

    info = texture_info(name)
    if pixels > _LEVEL_PIXELS:
        return _reduced_levels(_packed(texture_set(name)))
    path = cache_dir(_FOLDER) / f"{info.name}-{content_version()}.npy"
    sizes = [_LEVEL_PIXELS >> level for level in range(_LEVEL_PIXELS.bit_length())]
    ends = np.cumsum([2 * size * size * 4 for size in sizes])
    try:
        stored = np.load(path, mmap_mode="r")
    except (OSError, ValueError, EOFError):
        stored = None
    if stored is None or stored.shape != (ends[-1],) or stored.dtype != np.uint8:
        levels = _reduced_levels(_packed(texture_set(name)))[1:]
        content = io.BytesIO()
        np.save(content, np.concatenate([level.ravel() for level in levels]))
        _store(path, content.getvalue(), f"{info.name}-????????????????.npy")
    else:
        levels = [part.reshape(2, size, size, 4) for part, size in zip(np.split(stored, ends[:-1]), sizes, strict=True)]
    return [level for level in levels if level.shape[1] < 2 * pixels] or levels[-1:]


def _packed(textures: TextureSet) -> NDArray[uint8]:
    import numpy as np

    packed = np.full((2, *textures.roughness.shape, 4), 255, dtype=np.uint8)
    packed[0, ..., :3] = textures.color
    packed[1, ..., :2], packed[1, ..., 2] = textures.normal[..., :2], textures.roughness
    return packed


def _reduced_levels(image: NDArray[uint8]) -> list[NDArray[uint8]]:
    """An image and its halves, down to one pixel."""
    import numpy as np

    levels = [image]
    while levels[-1].shape[1] > 1:
        count, height, width, channels = levels[-1].shape
        blocks = levels[-1].reshape(count, height // 2, 2, width // 2, 2, channels)
        levels.append(np.rint(blocks.mean(axis=(2, 4))).astype(np.uint8))
    return levels


def _path(info: TextureInfo) -> Path:
    return cache_dir(_FOLDER) / f"{info.name}-{content_version()}.png"


def _load(info: TextureInfo) -> TextureSet | None:
    """The images in the cache; None if there are none, or the file is damaged."""
    import numpy as np
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(_path(info)) as file:
            stacked = np.asarray(file.convert("RGB"), dtype=np.uint8)
    except (OSError, UnidentifiedImageError):
        return None
    if stacked.shape != (3 * _PIXELS, _PIXELS, 3):
        return None
    color, normal, roughness = (stacked[at : at + _PIXELS] for at in range(0, len(stacked), _PIXELS))
    return TextureSet(info.name, color, np.ascontiguousarray(roughness[..., 0]), normal, info.size)


def _bake_and_store(info: TextureInfo) -> TextureSet:
    import numpy as np
    from PIL import Image

    texture = bake(info)
    gray = np.repeat(texture.roughness[..., None], 3, axis=2)
    content = io.BytesIO()
    Image.fromarray(np.concatenate([texture.color, texture.normal, gray])).save(content, "png", compress_level=1)
    _store(_path(info), content.getvalue(), f"{info.name}-????????????????.png")
    return texture


def _store(path: Path, content: bytes, pattern: str) -> None:
    """Writes a file to the cache, and removes those of other versions."""
    try:
        atomic_write(path, content)
        for outdated in path.parent.glob(pattern):
            if outdated != path:
                outdated.unlink(missing_ok=True)
    except OSError:  # a full or read-only disk: the images are computed again by the next process
        return


def bake(info: TextureInfo) -> TextureSet:
    """Computes the images of a texture; always the same."""
    import numpy as np

    from mindstage.textures.hard_surfaces import HARD_SURFACES
    from mindstage.textures.noise import Grid
    from mindstage.textures.soft_surfaces import SOFT_SURFACES
    from mindstage.textures.woods import WOODS

    recipe = {**WOODS, **HARD_SURFACES, **SOFT_SURFACES}[info.name]
    seed = int.from_bytes(blake2b(info.name.encode(), digest_size=4).digest(), "big")
    surface = recipe(Grid(seed, info.size, _PIXELS))
    return TextureSet(
        name=info.name,
        color=_color_image(surface),
        roughness=np.rint(255.0 * np.clip(surface.roughness, 0.0, 1.0)).astype(np.uint8),
        normal=_normal_image(surface.height, info.size),
        size=info.size,
    )


def _color_image(surface: Surface) -> NDArray[uint8]:
    import numpy as np

    shade = surface.shade if surface.shade.ndim == 3 else np.repeat(surface.shade[..., None], 3, axis=2)
    shade = np.maximum(shade, 0.0)
    neutral = shade / shade.mean(axis=(0, 1))
    neutral /= max(float(np.quantile(neutral[::3, ::3], _BRIGHTEST)), 1.0)
    return np.asarray(np.rint(255.0 * _srgb(np.clip(neutral, 0.0, 1.0))), dtype=np.uint8)


def _normal_image(height: Array, size: tuple[float, float]) -> NDArray[uint8]:
    """Normals of a height field [m] by central differences across the edges."""
    import numpy as np

    rows, columns = height.shape
    right = (np.roll(height, -1, axis=1) - np.roll(height, 1, axis=1)) * (columns / (2.0 * size[0]))
    up = (np.roll(height, 1, axis=0) - np.roll(height, -1, axis=0)) * (rows / (2.0 * size[1]))
    normal = np.stack([-right, -up, np.ones_like(height)], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    return np.asarray(np.rint(127.5 * (normal + 1.0)), dtype=np.uint8)


def _srgb(linear: Array) -> Array:
    import numpy as np

    return np.asarray(
        np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)
    )


def _linear(srgb: Array) -> Array:
    import numpy as np

    return np.asarray(np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4))
