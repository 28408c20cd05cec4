"""OpenGL without a display: EGL (a GPU, or Mesa's software renderer), else OSMesa; and the functions of OpenGL.

The libraries are called directly: PyOpenGL takes longer to import than a picture is rendered, and one process can use
only one platform of it.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from ctypes import byref, c_char_p, c_float, c_int, c_ubyte, c_uint, c_void_p
from typing import Any, Self

from mindstage.errors import RendererUnavailableError

__all__ = ["OffscreenContext", "OpenGL"]


_EGL_PLATFORM_SURFACELESS, _EGL_PLATFORM_DEVICE = 0x31DD, 0x313F
_EGL_OPENGL_API = 0x30A2
"""These are codes of EGL."""
_EGL_ATTRIBUTES = (
    *(0x3024, 8, 0x3023, 8, 0x3022, 8, 0x3021, 8),  # red, green, blue and alpha
    *(0x3025, 24, 0x3026, 8),  # depth and stencil
    *(0x3033, 0x0001),  # surface type: pbuffer
    *(0x3040, 0x0008),  # renderable type: OpenGL
    0x3038,
)
_GL_RGBA, _GL_UNSIGNED_BYTE = 0x1908, 0x1401
"""These are codes of OpenGL."""
_REMEDY = "install libegl1 and libgl1-mesa-dri (Debian, Ubuntu; or libosmesa6)"


class OffscreenContext:
    """An OpenGL context that is current in the calling thread until it is closed; a context manager."""

    def __init__(self) -> None:
        """Creates the context and makes it current.

        Raises:
            RendererUnavailableError: neither EGL nor OSMesa works here.
        """
        causes = []
        for name, create in (("egl", _create_egl), ("osmesa", _create_osmesa)):
            self._free: Callable[[], None] = _do_nothing
            try:
                self._free, address = create()
                self.gl = OpenGL(address)
                """The functions of OpenGL."""
            except OSError as error:
                self._free()
                causes.append(f"{name.upper() if name == 'egl' else 'OSMesa'}: {error}")
                continue
            self.platform = name
            """The library that is used: egl or osmesa."""
            return
        raise RendererUnavailableError("OpenGL", cause="; ".join(causes), remedy=_REMEDY)

    def close(self) -> None:
        """Frees the context; calling it again is harmless."""
        free, self._free = self._free, _do_nothing
        free()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _do_nothing() -> None:
    pass


_FunctionAddress = Callable[[bytes], int | None]
"""Returns the address of a function of OpenGL."""

_SIZE, _FLOATS = ctypes.c_ssize_t, ctypes.POINTER(c_float)
_SIGNATURES: dict[str, tuple[Any, ...]] = {
    "glActiveTexture": (None, c_uint),
    "glAttachShader": (None, c_uint, c_uint),
    "glBindBuffer": (None, c_uint, c_uint),
    "glBindFramebuffer": (None, c_uint, c_uint),
    "glBindRenderbuffer": (None, c_uint, c_uint),
    "glBindSampler": (None, c_uint, c_uint),
    "glBindTexture": (None, c_uint, c_uint),
    "glBindVertexArray": (None, c_uint),
    "glBlendFunc": (None, c_uint, c_uint),
    "glBlitFramebuffer": (None, *[c_int] * 8, c_uint, c_uint),
    "glBufferData": (None, c_uint, _SIZE, c_void_p, c_uint),
    "glCheckFramebufferStatus": (c_uint, c_uint),
    "glClear": (None, c_uint),
    "glClearBufferfv": (None, c_uint, c_int, c_void_p),
    "glClearBufferuiv": (None, c_uint, c_int, c_void_p),
    "glClearColor": (None, c_float, c_float, c_float, c_float),
    "glColorMask": (None, c_ubyte, c_ubyte, c_ubyte, c_ubyte),
    "glCompileShader": (None, c_uint),
    "glCreateProgram": (c_uint,),
    "glCreateShader": (c_uint, c_uint),
    "glDepthFunc": (None, c_uint),
    "glDepthMask": (None, c_ubyte),
    "glDisable": (None, c_uint),
    "glDrawArrays": (None, c_uint, c_int, c_int),
    "glDrawBuffer": (None, c_uint),
    "glDrawBuffers": (None, c_int, c_void_p),
    "glDrawElements": (None, c_uint, c_int, c_uint, c_void_p),
    "glEnable": (None, c_uint),
    "glEnableVertexAttribArray": (None, c_uint),
    "glFramebufferRenderbuffer": (None, c_uint, c_uint, c_uint, c_uint),
    "glFramebufferTexture2D": (None, c_uint, c_uint, c_uint, c_uint, c_int),
    "glGenBuffers": (None, c_int, c_void_p),
    "glGenFramebuffers": (None, c_int, c_void_p),
    "glGenRenderbuffers": (None, c_int, c_void_p),
    "glGenSamplers": (None, c_int, c_void_p),
    "glGenTextures": (None, c_int, c_void_p),
    "glGenVertexArrays": (None, c_int, c_void_p),
    "glGenerateMipmap": (None, c_uint),
    "glGetError": (c_uint,),
    "glGetIntegerv": (None, c_uint, c_void_p),
    "glGetProgramInfoLog": (None, c_uint, c_int, c_void_p, c_char_p),
    "glGetProgramiv": (None, c_uint, c_uint, c_void_p),
    "glGetShaderInfoLog": (None, c_uint, c_int, c_void_p, c_char_p),
    "glGetShaderiv": (None, c_uint, c_uint, c_void_p),
    "glGetString": (c_char_p, c_uint),
    "glGetUniformLocation": (c_int, c_uint, c_char_p),
    "glLinkProgram": (None, c_uint),
    "glMultiDrawElements": (None, c_uint, c_void_p, c_uint, c_void_p, c_int),
    "glPixelStorei": (None, c_uint, c_int),
    "glPolygonOffset": (None, c_float, c_float),
    "glReadBuffer": (None, c_uint),
    "glReadPixels": (None, c_int, c_int, c_int, c_int, c_uint, c_uint, c_void_p),
    "glRenderbufferStorageMultisample": (None, c_uint, c_int, c_uint, c_int, c_int),
    "glSamplerParameteri": (None, c_uint, c_uint, c_int),
    "glShaderSource": (None, c_uint, c_int, ctypes.POINTER(c_char_p), c_void_p),
    "glTexImage2D": (None, c_uint, c_int, c_int, c_int, c_int, c_int, c_uint, c_uint, c_void_p),
    "glTexParameteri": (None, c_uint, c_uint, c_int),
    "glUniform1f": (None, c_int, c_float),
    "glUniform1i": (None, c_int, c_int),
    "glUniform2f": (None, c_int, c_float, c_float),
    "glUniform2i": (None, c_int, c_int, c_int),
    "glUniform3fv": (None, c_int, c_int, _FLOATS),
    "glUniform4fv": (None, c_int, c_int, _FLOATS),
    "glUniformMatrix3fv": (None, c_int, c_int, c_ubyte, _FLOATS),
    "glUniformMatrix4fv": (None, c_int, c_int, c_ubyte, _FLOATS),
    "glUseProgram": (None, c_uint),
    "glVertexAttribPointer": (None, c_uint, c_int, c_uint, c_ubyte, c_int, c_void_p),
    "glViewport": (None, c_int, c_int, c_int, c_int),
}
"""Result and arguments of the functions that are used."""
_LEAST_VERSION = (3, 3)
_VERSION = 0x1F02


class OpenGL:
    """The functions of OpenGL 3.3 in the current context, by their names, such as `gl.glClear(mask)`."""

    def __init__(self, address: _FunctionAddress) -> None:
        """Finds the functions.

        Raises:
            OSError: OpenGL is older than 3.3, or a function is missing.
        """
        self._functions: dict[str, Callable[..., Any]] = {}
        for name, signature in _SIGNATURES.items():
            found = address(name.encode())
            if not found:
                raise OSError(f"it has no {name}")
            self._functions[name] = ctypes.CFUNCTYPE(*signature)(found)
        text = (self.glGetString(_VERSION) or b"0.0").decode()
        major, minor = text.split()[0].split(".")[:2]
        if (int(major), int(minor)) < _LEAST_VERSION:
            raise OSError(f"it offers OpenGL {text}, and 3.3 is needed")

    def __getattr__(self, name: str) -> Callable[..., Any]:
        """A function of OpenGL."""
        try:
            return self._functions[name]
        except KeyError:
            raise AttributeError(name) from None


def _create_egl() -> tuple[Callable[[], None], _FunctionAddress]:
    """Creates an EGL context without a surface, and returns the functions that free it and that find OpenGL's.

    Raises:
        OSError: the library is missing, or no context can be created.
    """
    egl = ctypes.CDLL("libEGL.so.1", mode=ctypes.RTLD_GLOBAL)
    egl.eglGetProcAddress.restype = c_void_p
    egl.eglInitialize.argtypes = [c_void_p, c_void_p, c_void_p]
    egl.eglChooseConfig.argtypes = [c_void_p, c_void_p, c_void_p, c_int, c_void_p]
    egl.eglCreateContext.argtypes, egl.eglCreateContext.restype = [c_void_p] * 4, c_void_p
    egl.eglMakeCurrent.argtypes = [c_void_p] * 4
    egl.eglDestroyContext.argtypes = [c_void_p] * 2
    display = _egl_display(egl)
    egl.eglBindAPI(_EGL_OPENGL_API)
    attributes, config, count = (c_int * len(_EGL_ATTRIBUTES))(*_EGL_ATTRIBUTES), c_void_p(), c_int()
    if not egl.eglChooseConfig(display, attributes, byref(config), 1, byref(count)) or not count.value:
        raise OSError("it offers no OpenGL with 24 bits of depth")
    context = egl.eglCreateContext(display, config, None, None)
    if not context or not egl.eglMakeCurrent(display, None, None, context):
        raise OSError("it cannot create an OpenGL context")

    def free() -> None:
        egl.eglMakeCurrent(display, None, None, None)
        egl.eglDestroyContext(display, context)

    return free, egl.eglGetProcAddress


def _egl_display(egl: ctypes.CDLL) -> int:
    """An initialized display: of the first device that works, else without one.

    Raises:
        OSError: there is none.
    """
    get_display = _egl_function(egl, b"eglGetPlatformDisplayEXT", c_uint, c_void_p, c_void_p)
    query_devices = _egl_function(egl, b"eglQueryDevicesEXT", c_int, c_void_p, c_void_p)
    choices: list[tuple[int, int | None]] = [(_EGL_PLATFORM_SURFACELESS, None)]
    if get_display is None:
        raise OSError("it has no displays without a window system")
    if query_devices is not None:
        devices, count = (c_void_p * 16)(), c_int()
        query_devices(16, devices, byref(count))
        choices = [*((_EGL_PLATFORM_DEVICE, devices[each]) for each in range(count.value)), *choices]
    for platform, device in choices:
        display = get_display(platform, device, None)
        if display and egl.eglInitialize(display, None, None):
            return int(display)
    raise OSError("it finds no device")


def _egl_function(egl: ctypes.CDLL, name: bytes, *arguments: type) -> Callable[..., int] | None:
    address = egl.eglGetProcAddress(name)
    return ctypes.CFUNCTYPE(c_void_p, *arguments)(address) if address else None


def _create_osmesa() -> tuple[Callable[[], None], _FunctionAddress]:
    """Creates an OSMesa context, and returns the functions that free it and that find OpenGL's.

    Raises:
        OSError: the library is missing, or no context can be created.
    """
    mesa = _load_osmesa()
    mesa.OSMesaCreateContextExt.restype = c_void_p
    mesa.OSMesaMakeCurrent.argtypes = [c_void_p, c_void_p, c_uint, c_int, c_int]
    mesa.OSMesaDestroyContext.argtypes = [c_void_p]
    mesa.OSMesaGetProcAddress.restype = c_void_p
    context = mesa.OSMesaCreateContextExt(_GL_RGBA, 24, 8, 0, None)
    # Pictures are rendered to a framebuffer object; the context needs a buffer of its own all the same.
    pixels = ctypes.create_string_buffer(4)
    if not context or not mesa.OSMesaMakeCurrent(context, pixels, _GL_UNSIGNED_BYTE, 1, 1):
        raise OSError("it cannot create an OpenGL context")

    def free(_pixels: object = pixels) -> None:  # the buffer must live as long as the context
        mesa.OSMesaDestroyContext(context)

    return free, mesa.OSMesaGetProcAddress


def _load_osmesa() -> ctypes.CDLL:
    for version in ("8", "6"):
        try:
            return ctypes.CDLL(f"libOSMesa.so.{version}", mode=ctypes.RTLD_GLOBAL)
        except OSError:
            continue
    raise OSError("libOSMesa.so is not installed")
