"""What renderers by OpenGL have in common: programs, textures, framebuffers, and meshes as vertices."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mindstage.errors import RendererUnavailableError
from mindstage.rendering import gl_codes as codes
from mindstage.rendering.gl_context import OpenGL
from mindstage.scene import VisualMesh
from mindstage.scene.mesh import cut_above, face_normals
from mindstage.scene.transforms import Array

__all__ = [
    "ATTRIBUTES",
    "VERTEX",
    "Drawing",
    "FramedMesh",
    "Program",
    "TextureKey",
    "merged_vertices",
    "mesh_part",
    "repeat_length",
]

Bytes = NDArray[np.uint8]


class Program:
    """A pair of shaders, and its uniforms."""

    def __init__(self, gl: OpenGL, sources: tuple[str, str]) -> None:
        self._gl, self._id, self._locations = gl, gl.glCreateProgram(), dict[str, int]()
        for kind, source in zip((codes.VERTEX_SHADER, codes.FRAGMENT_SHADER), sources, strict=True):
            shader = gl.glCreateShader(kind)
            text = ctypes.c_char_p(source.encode())
            gl.glShaderSource(shader, 1, ctypes.byref(text), None)
            gl.glCompileShader(shader)
            self._check(shader, gl.glGetShaderiv, codes.COMPILED, gl.glGetShaderInfoLog)
            gl.glAttachShader(self._id, shader)
        gl.glLinkProgram(self._id)
        self._check(self._id, gl.glGetProgramiv, codes.LINKED, gl.glGetProgramInfoLog)

    def _check(self, id: int, get: Any, status: int, get_log: Any) -> None:
        done = ctypes.c_int()
        get(id, status, ctypes.byref(done))
        if not done.value:
            log = ctypes.create_string_buffer(4000)
            get_log(id, len(log), None, log)
            cause = f"a shader cannot be compiled: {log.value.decode(errors='replace').strip()}"
            raise RendererUnavailableError("OpenGL", cause=cause, remedy="use another driver of OpenGL")

    def use(self, **uniforms: object) -> None:
        """Makes the program current, and sets its uniforms: numbers, tuples of them and arrays."""
        self._gl.glUseProgram(self._id)
        for name, value in uniforms.items():
            self.set(name, value)

    def set(self, name: str, value: object) -> None:
        """Sets a uniform of the current program."""
        if name not in self._locations:
            self._locations[name] = self._gl.glGetUniformLocation(self._id, name.encode())
        at, gl = self._locations[name], self._gl
        match value:
            case bool() | int():
                gl.glUniform1i(at, int(value))
            case float():
                gl.glUniform1f(at, value)
            case (int(), int()):
                gl.glUniform2i(at, *value)
            case (_, _):
                gl.glUniform2f(at, *value)
            case _:
                numbers = np.ascontiguousarray(value, dtype=np.float32)
                pointer = numbers.ctypes.data_as(ctypes.POINTER(ctypes.c_float))
                if numbers.ndim == 2 and numbers.shape[0] == numbers.shape[1]:
                    (gl.glUniformMatrix3fv if len(numbers) == 3 else gl.glUniformMatrix4fv)(at, 1, 1, pointer)
                else:
                    count = max(numbers.size // numbers.shape[-1], 1)
                    (gl.glUniform3fv if numbers.shape[-1] == 3 else gl.glUniform4fv)(at, count, pointer)


class Drawing:
    """OpenGL objects, which are freed together with the context."""

    def __init__(self, gl: OpenGL) -> None:
        self._gl = gl

    def _repeating(self, levels: Iterable[Bytes]) -> int:
        """A texture that repeats, from levels of decreasing resolution; missing ones are computed."""
        gl, texture = self._gl, self._generate("glGenTextures")
        self._bind(0, texture)
        height = width = number = 0
        for number, level in enumerate(levels):
            pixels = np.ascontiguousarray(level[::-1])  # the first row of OpenGL is the lowest one
            height, width, _ = pixels.shape
            gl.glTexImage2D(
                codes.TEXTURE_2D,
                number,
                codes.RGBA8,
                width,
                height,
                0,
                codes.RGBA,
                codes.UNSIGNED_BYTE,
                pixels.ctypes.data,
            )
        if number == 0 and max(height, width) > 1:
            gl.glGenerateMipmap(codes.TEXTURE_2D)
        settings = (
            (codes.MIN_FILTER, codes.LINEAR_MIPMAPS),
            (codes.MAG_FILTER, codes.LINEAR),
            (codes.WRAP_S, codes.REPEAT),
            (codes.WRAP_T, codes.REPEAT),
        )
        for name, value in settings:
            gl.glTexParameteri(codes.TEXTURE_2D, name, value)
        return texture

    def _texture(
        self,
        stored: int,
        size: tuple[int, int],
        form: int,
        kind: int,
        pixels: Bytes | None,
        *,
        filter: int = codes.NEAREST,
    ) -> int:
        gl, texture = self._gl, self._generate("glGenTextures")
        self._bind(0, texture)
        data = None if pixels is None else pixels.ctypes.data
        gl.glTexImage2D(codes.TEXTURE_2D, 0, stored, *size, 0, form, kind, data)
        for name, value in (
            (codes.MIN_FILTER, filter),
            (codes.MAG_FILTER, filter),
            (codes.WRAP_S, codes.CLAMP),
            (codes.WRAP_T, codes.CLAMP),
        ):
            gl.glTexParameteri(codes.TEXTURE_2D, name, value)
        return texture

    def _comparing_sampler(self) -> int:
        """Reads a shadow map: compares depths, and interpolates the results."""
        sampler = self._generate("glGenSamplers")
        settings = (
            (codes.MIN_FILTER, codes.LINEAR),
            (codes.MAG_FILTER, codes.LINEAR),
            (codes.WRAP_S, codes.CLAMP),
            (codes.WRAP_T, codes.CLAMP),
        )
        for name, value in (*settings, (codes.COMPARE_MODE, codes.COMPARE_TO_TEXTURE)):
            self._gl.glSamplerParameteri(sampler, name, value)
        return sampler

    def _enable_attributes(self) -> None:
        """Takes the attributes of vertices from the bound buffer, for the bound array."""
        gl, fields = self._gl, VERTEX.fields
        assert fields is not None
        for location, (name, count, is_bytes) in enumerate(ATTRIBUTES):
            gl.glEnableVertexAttribArray(location)
            kind = codes.UNSIGNED_BYTE if is_bytes else codes.FLOAT
            gl.glVertexAttribPointer(location, count, kind, is_bytes, VERTEX.itemsize, fields[name][1])

    def _bind(self, unit: int, texture: int) -> None:
        self._gl.glActiveTexture(codes.TEXTURE0 + unit)
        self._gl.glBindTexture(codes.TEXTURE_2D, texture)

    def _target(self, *, color: int = 0, depth: int = 0) -> int:
        """Draws into textures from now on; the framebuffer."""
        gl, target = self._gl, self._generate("glGenFramebuffers")
        gl.glBindFramebuffer(codes.FRAMEBUFFER, target)
        if color:
            gl.glFramebufferTexture2D(codes.FRAMEBUFFER, codes.COLOR_ATTACHMENT, codes.TEXTURE_2D, color, 0)
        else:
            gl.glDrawBuffer(0)
            gl.glReadBuffer(0)
        if depth:
            gl.glFramebufferTexture2D(codes.FRAMEBUFFER, codes.DEPTH_ATTACHMENT, codes.TEXTURE_2D, depth, 0)
        self._check_target()
        return target

    def _check_target(self) -> None:
        status = self._gl.glCheckFramebufferStatus(codes.FRAMEBUFFER)
        if status != codes.COMPLETE:
            cause = f"a framebuffer of this size is refused ({status:#x})"
            raise RendererUnavailableError("OpenGL", cause=cause, remedy="choose a smaller size")

    def _generate(self, function: str) -> int:
        id = ctypes.c_uint()
        getattr(self._gl, function)(1, ctypes.byref(id))
        return id.value


VERTEX = np.dtype(
    [
        *(("position", "<f4", 3), ("normal", "<f4", 3), ("uv", "<f4", 2)),
        *(("color", "u1", 4), ("material", "u1", 4), ("number", "<f4")),
    ]
)
ATTRIBUTES = (
    ("position", 3, 0),
    ("normal", 3, 0),
    ("uv", 2, 0),
    ("color", 4, 1),
    ("material", 4, 1),
    ("number", 1, 0),
)
"""Name, number of components, and whether these are bytes from 0 to 1; in the order of their locations."""
_COLUMNS = {"position": slice(0, 3), "normal": slice(3, 6), "uv": slice(6, 8)}

TextureKey = str | int
"""The name of a procedural texture, empty for none, or the identity of an image."""


@dataclass(frozen=True, slots=True, eq=False)
class FramedMesh:
    """A mesh in the world frame."""

    columns: Array
    """n x 9: points, normals, texture coordinates and the number of the item."""
    factors: Array
    """Color, opacity, roughness, metalness, emission, and 0 for what is not the ground; from 0 to 1."""
    faces: NDArray[np.int64]


def mesh_part(visual: VisualMesh, rotation: Array, position: Array, number: int) -> FramedMesh:
    """A mesh in another frame.

    Args:
        rotation: the transposed rotation matrix into that frame.
        position: its origin there [m].
        number: of the item that it is of.
    """
    points, normals, uv, faces = visual.points, visual.normals, visual.uv, visual.faces.astype(np.int64)
    if normals is None:  # corners of flat faces are not shared
        normals, at = face_normals(points, faces).repeat(3, axis=0), faces.reshape(-1)
        points, uv = points[at], None if uv is None else uv[at]
        faces = np.arange(len(points)).reshape(-1, 3)
    columns = np.zeros((len(points), 9))
    columns[:, :3] = points @ rotation + position
    columns[:, 3:6] = normals @ rotation
    if uv is not None:
        columns[:, 6:8] = uv
    columns[:, 8] = number
    material = visual.material
    surface = material.roughness, material.metalness, min(material.emission, 1.0), 0.0
    return FramedMesh(columns, np.array((*material.color, material.opacity, *surface)), faces)


def merged_vertices(
    parts: Sequence[FramedMesh], clip_height: float | None
) -> tuple[NDArray[np.void], NDArray[np.int64]]:
    """Joins meshes to an array of `VERTEX` and faces; nothing above the clipping height is kept [m]."""
    counts = [len(part.columns) for part in parts]
    starts = np.cumsum([0, *counts])
    faces = np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=False)])
    columns = np.concatenate([part.columns for part in parts])
    factors = np.repeat([part.factors for part in parts], counts, axis=0)
    if clip_height is not None:
        columns = np.concatenate([columns, factors], axis=1)
        columns, faces = cut_above(columns, faces, columns[:, 2], clip_height)
        columns, factors = columns[:, :9], columns[:, 9:]
    vertices = np.zeros(len(columns), VERTEX)
    for name, column in _COLUMNS.items():
        vertices[name] = columns[:, column]
    vertices["number"] = columns[:, 8]
    whole = np.clip(np.rint(factors * 255), 0, 255).astype(np.uint8)
    vertices["color"], vertices["material"] = whole[:, :4], whole[:, 4:]
    return vertices, faces


def repeat_length(vertices: NDArray[np.void], faces: NDArray[np.integer[Any]]) -> float:
    """Over which length on the surface the texture coordinates grow by 1 [m]."""
    points, uv = vertices["position"][faces].astype(float), vertices["uv"][faces].astype(float)
    across = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    one, other = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    area = float(np.abs(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]).sum())
    return math.sqrt(float(np.linalg.norm(across, axis=1).sum()) / max(area, 1e-9))
