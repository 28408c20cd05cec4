"""OpenGL contexts without a display, for MuJoCo's renderer: EGL (a GPU, or Mesa's software renderer), else OSMesa.

The two libraries are called directly: the modules of MuJoCo for that import PyOpenGL, which takes longer than a picture
is rendered, and of which one process can use only one platform.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable
from ctypes import byref, c_int, c_uint, c_void_p
from typing import Self

from mindstage.errors import RendererUnavailableError

__all__ = ["OffscreenContext"]


_EGL_PLATFORM_SURFACELESS, _EGL_PLATFORM_DEVICE = 0x31DD, 0x313F
_EGL_OPENGL_API = 0x30A2
_EGL_ATTRIBUTES = (
    *(0x3024, 8, 0x3023, 8, 0x3022, 8, 0x3021, 8),  # red, green, blue and alpha
    *(0x3025, 24, 0x3026, 8),  # depth and stencil
    *(0x3033, 0x0001),  # surface type: pbuffer
    *(0x3040, 0x0008),  # renderable type: OpenGL
    0x3038,
)
_GL_RGBA, _GL_UNSIGNED_BYTE = 0x1908, 0x1401
_REMEDY = "install libegl1 and libgl1-mesa-dri (Debian, Ubuntu; or libosmesa6), or render in a browser with --page"


class OffscreenContext:
    """An OpenGL context that is current in the calling thread until it is closed; a context manager."""

    def __init__(self) -> None:
        """Creates the context and makes it current.

        Raises:
            RendererUnavailableError: neither EGL nor OSMesa works here.
        """
        causes = []
        for name, create in (("egl", _create_egl), ("osmesa", _create_osmesa)):
            try:
                self._free = create()
            except OSError as error:
                causes.append(f"{name.upper() if name == 'egl' else 'OSMesa'}: {error}")
                continue
            # MuJoCo's library reads this when it loads OpenGL, whatever it was when the module was imported.
            os.environ["MUJOCO_GL"] = name
            self.platform = name
            """The library that is used: egl or osmesa."""
            return
        raise RendererUnavailableError("OpenGL", cause="; ".join(causes), remedy=_REMEDY)

    def close(self) -> None:
        """Frees the context; calling it again is harmless."""
        free, self._free = self._free, lambda: None
        free()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _create_egl() -> Callable[[], None]:
    """Creates an EGL context without a surface, and returns the function that frees it.

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

    return free


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


def _create_osmesa() -> Callable[[], None]:
    """Creates an OSMesa context, and returns the function that frees it.

    Raises:
        OSError: the library is missing, or no context can be created.
    """
    mesa = _load_osmesa()
    mesa.OSMesaCreateContextExt.restype = c_void_p
    mesa.OSMesaMakeCurrent.argtypes = [c_void_p, c_void_p, c_uint, c_int, c_int]
    mesa.OSMesaDestroyContext.argtypes = [c_void_p]
    context = mesa.OSMesaCreateContextExt(_GL_RGBA, 24, 8, 0, None)
    # Pictures are rendered to a framebuffer object; the context needs a buffer of its own all the same.
    pixels = ctypes.create_string_buffer(4)
    if not context or not mesa.OSMesaMakeCurrent(context, pixels, _GL_UNSIGNED_BYTE, 1, 1):
        raise OSError("it cannot create an OpenGL context")

    def free(_pixels: object = pixels) -> None:  # the buffer must live as long as the context
        mesa.OSMesaDestroyContext(context)

    return free


def _load_osmesa() -> ctypes.CDLL:
    for version in ("8", "6"):
        try:
            return ctypes.CDLL(f"libOSMesa.so.{version}", mode=ctypes.RTLD_GLOBAL)
        except OSError:
            continue
    raise OSError("libOSMesa.so is not installed")
