"""Reading and writing images; the one module that knows OpenImageIO."""

from __future__ import annotations

import json
import numbers
import os
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio

from tpdwarp.errors import FrameError, InputError, shortened
from tpdwarp.io.files import complete_or_absent
from tpdwarp.io.image_region import ImageRegion
from tpdwarp.io.memory import memory_allowed

DISPLAY_BITS = {".png": "uint8", ".jpg": "uint8", ".jpeg": "uint8", ".tif": "uint16", ".tiff": "uint16"}
EXTENSIONS = (".exr", *DISPLAY_BITS)

# Colours go out as half. What is measured, or used as a coordinate, does not fit: it needs the range or the digits.
FLOAT_LAYERS = ("Z", "N", "P", "motion", "irradiance", "photons", "vector", "id")
# Holds hashes, which are 32 bits of a float whatever was asked for.
HASH_LAYER = "CryptoObject"
HALF_MAXIMUM = float(np.finfo(np.float16).max)

# Their writers hide a failed write (PNG) or end the process at one (JPEG).
SILENT_EXTENSIONS = (".png", ".jpg", ".jpeg")

# Have no place for attributes of one's own.
PLAIN_EXTENSIONS = (".jpg", ".jpeg", ".tif", ".tiff")

# What a frame was made from; see :mod:`tpdwarp.jobs.fingerprint`.
FINGERPRINT = "tpdwarp:fingerprint"

# OpenImageIO has names of its own for two of OpenEXR's attributes.
ATTRIBUTE_NAMES = {"capDate": "DateTime", "expTime": "ExposureTime"}

# An image is held as read, and compared as planes, with differences beside them.
IMAGE_COPIES = 4

# A process that is forked does not have OpenEXR's threads, and would wait for them with its next file. Frames are
# written as fast without any.
oiio.attribute("exr_threads", -1)

# The configuration built into OpenImageIO, so that an $OCIO meant for other programs changes no picture.
COLOR_CONFIG = "ocio://default"


def check_format(path: str | os.PathLike[str], aovs: Sequence[str] = (), view: str = "") -> None:
    """Refuses a file name whose extension is not one that :func:`write_frame` knows.

    Args:
        path: Where frames will be written.
        aovs: Channel groups wanted beside the beauty; only EXR holds them.
        view: The one that is shown in the place of the beauty, in other formats than EXR.

    Raises:
        InputError: The extension is unknown, or the format cannot hold ``aovs``.
    """
    extension = Path(path).suffix.lower()
    if extension not in EXTENSIONS:
        named = f"the image format {extension!r} is unknown" if extension else "the file name has no extension"
        raise InputError(f"{named} (use one of {', '.join(EXTENSIONS)})", file=os.fspath(path))
    if view and extension == ".exr":
        raise InputError("--view is for .png, .jpg and .tif (EXR holds all of --aov)", file=os.fspath(path))
    others = [aov for aov in aovs if aov != view]
    if others and extension != ".exr":
        held = f"{extension} holds the beauty only" if not view else f"{extension} holds one picture"
        raise InputError(f"{held}, not {', '.join(others)} (use .exr, or choose one with --view)", file=os.fspath(path))


def write_frame(
    path: str | os.PathLike[str],
    channels: Mapping[str, np.ndarray],
    metadata: Mapping[str, Any],
    depth: str | None = None,
    region: ImageRegion | None = None,
) -> None:
    """Writes one frame; it appears under its name only when complete.

    EXR takes all channels, R, G, B and A first and the others as given (zip, scan lines): colours as half, limited to
    ±65504, the layers of ``FLOAT_LAYERS`` as float. The other formats take the beauty only, sRGB encoded: PNG and JPEG
    with 8 bits, TIFF with 16; PNG and TIFF with alpha, JPEG over black.

    Attributes of one's own go into EXR and PNG; JPEG and TIFF keep that of ``FINGERPRINT``, as their description.

    Args:
        path: The file, with one of ``EXTENSIONS``; its folder exists.
        channels: Channel name (``R``, ``caustic.G``, ``Z``) to pixels, top row first, shape [h, w]; linear Rec.709,
            colours multiplied by alpha.
        metadata: Attributes by their EXR names; see :func:`set_attribute` for the types.
        depth: ``half`` or ``float`` for all channels of an EXR; None for each as above.
        region: The part of an image that the pixels are, which an EXR's data window says; None for all of it.

    Raises:
        InputError: The extension is unknown.
        FrameError: A pixel is not finite, or the file cannot be written.
    """
    check_format(path)
    refuse_non_finite(path, channels)
    beauty = [name for name in "RGBA" if name in channels]
    if Path(path).suffix.lower() == ".exr":
        names = beauty + [name for name in channels if name not in beauty]
        depths = [_depth(name, depth) for name in names]
        pixels = np.stack([channels[name] for name in names], axis=-1).astype(np.float32)
        for index, own in enumerate(depths):
            if own == "half":
                np.clip(pixels[..., index], -HALF_MAXIMUM, HALF_MAXIMUM, out=pixels[..., index])
        # Where all channels are of one type, the image's counts and theirs does not.
        common = depths[0] if len(set(depths)) == 1 else "float"
        spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], len(names), common)
        spec.channelformats = tuple(oiio.TypeDesc(own) for own in depths)
        spec.attribute("compression", "zip")
        spec.attribute("oiio:ColorSpace", "lin_rec709")
        if region is not None:
            spec.x, spec.y, spec.full_width, spec.full_height = region.first, region.above, region.width, region.height
    else:
        extension = Path(path).suffix.lower()
        names = [name for name in beauty if name != "A" or extension not in (".jpg", ".jpeg")]
        pixels = encode_srgb(np.stack([channels[name] for name in names], axis=-1).astype(np.float32))
        spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], len(names), DISPLAY_BITS[extension])
        spec.attribute("compression", "jpeg:95" if extension in (".jpg", ".jpeg") else "zip")
        spec.attribute("jpeg:subsampling", "4:4:4")
        spec.attribute("oiio:ColorSpace", "sRGB")
        spec.attribute("oiio:UnassociatedAlpha", 1)
    spec.channelnames = tuple(names)
    spec.alpha_channel = names.index("A") if "A" in names else -1
    spec.z_channel = names.index("Z") if "Z" in names else -1
    for name, value in metadata.items():
        set_attribute(spec, name, value)
    if Path(path).suffix.lower() in PLAIN_EXTENSIONS and FINGERPRINT in metadata:
        spec.attribute("ImageDescription", f"{FINGERPRINT} {metadata[FINGERPRINT]}")
    with complete_or_absent(path) as temporary:
        if Path(path).suffix.lower() in SILENT_EXTENSIONS:
            write_surely(temporary, path, spec, pixels)
        else:
            write_pixels(temporary, path, spec, pixels)
            _check_end(temporary, path)


def _depth(channel: str, wanted: str | None) -> str:
    """The type of an EXR's channel; that of ``irradiance_key.R``, of a light group, is that of ``irradiance``."""
    if channel.startswith(HASH_LAYER):
        return "float"
    return wanted or ("float" if channel.partition(".")[0].partition("_")[0] in FLOAT_LAYERS else "half")


def write_pixels(temporary: str, path: str | os.PathLike[str], spec: oiio.ImageSpec, pixels: np.ndarray) -> None:
    """Writes ``pixels``, shape [h, w, channels], to ``temporary``; errors name ``path``.

    Raises:
        FrameError: The file cannot be written.
    """
    output = oiio.ImageOutput.create(temporary)
    if not (output and output.open(temporary, spec) and output.write_image(pixels) and output.close()):
        reason = output.geterror() if output else oiio.geterror()
        raise FrameError(f"{os.fspath(path)}: cannot be written: {' '.join(reason.split())}")


def _check_end(temporary: str, path: str | os.PathLike[str]) -> None:
    """Reads the last row back, since what a writer still holds as it closes a file may not find room, unsaid.

    Raises:
        FrameError: It is not there.
    """
    written, row = oiio.ImageInput.open(temporary), None
    if written:
        spec = written.spec()
        end = spec.y + spec.height
        row = written.read_scanlines(end - 1, end, 0, 0, spec.nchannels, "float")
        written.close()
    if row is None:
        raise FrameError(f"{os.fspath(path)}: cannot be written: its end is missing (is the disk full?)")


def write_surely(temporary: str, path: str | os.PathLike[str], spec: oiio.ImageSpec, pixels: np.ndarray) -> None:
    """Like :func:`write_pixels`, for writers that do not tell of a full disk.

    The space is tried before, and the file read after it is written: another process may have taken the space.

    Raises:
        FrameError: The file cannot be written.
    """
    try:
        Path(temporary).write_bytes(bytes(spec.image_bytes() + len(spec.to_xml()) + 2**16))
    except OSError as error:
        raise FrameError(f"{os.fspath(path)}: cannot be written: {error.strerror}") from error
    write_pixels(temporary, path, spec, pixels)
    try:
        read_image(temporary)
    except InputError as error:
        raise FrameError(f"{os.fspath(path)}: cannot be written: it came out damaged ({error.message})") from error


def refuse_non_finite(path: str | os.PathLike[str], channels: Mapping[str, np.ndarray]) -> None:
    """Checks that every pixel is a number.

    Raises:
        FrameError: One is not; names the first such pixel, as column and row from the top left.
    """
    for name, values in channels.items():
        finite = np.isfinite(values)
        if not finite.all():
            row, column = np.argwhere(~finite)[0]
            raise FrameError(
                f"{os.fspath(path)}: channel {name} is {values[row, column]} at pixel ({column}, {row}), "
                f"one of {np.count_nonzero(~finite)} that are not finite"
            )


def encode_srgb(pixels: np.ndarray) -> np.ndarray:
    """Linear Rec.709 as sRGB, shape [h, w, 3 or 4]; colours are divided by alpha first, as PNG wants them.

    Without an alpha channel colours are encoded as they are.
    """
    image = oiio.ImageBuf(np.ascontiguousarray(pixels, dtype=np.float32))
    if pixels.shape[-1] == 4:
        image.specmod().alpha_channel = 3
        image = oiio.ImageBufAlgo.unpremult(image)
    image = oiio.ImageBufAlgo.colorconvert(image, "lin_rec709", "sRGB", unpremult=False, colorconfig=COLOR_CONFIG)
    if image.has_error:
        raise FrameError(f"sRGB encoding failed: {image.geterror()}")
    return np.array(image.get_pixels("float"))


def set_attribute(spec: oiio.ImageSpec, name: str, value: Any) -> None:
    """Adds one attribute to an image's header.

    A string, whole number, number (single precision) or 4×4 array is stored as such (whole numbers beyond 32 bits as
    text), two to four numbers as a vector, anything else as JSON. ``framesPerSecond`` becomes a fraction (23.976 is
    24000/1001). None is left out.

    Raises:
        TypeError: The value has no JSON form.
    """
    name = ATTRIBUTE_NAMES.get(name, name)
    plain = value.tolist() if isinstance(value, np.ndarray | np.generic) else value
    if plain is None:
        return
    if name == "framesPerSecond":
        rate = exact_rate(float(plain))
        spec.attribute(name, oiio.TypeDesc("rational"), (rate.numerator, rate.denominator))
    elif isinstance(plain, str):
        spec.attribute(name, plain)
    elif isinstance(plain, numbers.Integral):
        spec.attribute(name, int(plain) if abs(plain) < 2**31 else str(plain))
    elif isinstance(plain, numbers.Real):
        spec.attribute(name, float(plain))
    elif np.shape(value) == (4, 4):
        spec.attribute(name, oiio.TypeDesc("matrix"), tuple(float(x) for row in value for x in row))
    elif is_vector(plain):
        spec.attribute(name, oiio.TypeDesc(f"float[{len(plain)}]"), tuple(float(x) for x in plain))
    else:
        spec.attribute(name, json.dumps(plain))


def is_vector(value: Any) -> bool:
    """Whether ``value`` is a list or tuple of two to four numbers."""
    return (
        isinstance(value, list | tuple) and 2 <= len(value) <= 4 and all(isinstance(x, numbers.Real) for x in value)
    )


def exact_rate(frames_per_second: float) -> Fraction:
    """The fraction meant by a decimal rate: n/1 or the television rates n·1000/1001 where near, else the closest."""
    for divisor in (Fraction(1), Fraction(1000, 1001)):
        rate = round(frames_per_second / divisor) * divisor
        if rate > 0 and abs(float(rate) - frames_per_second) < 5e-4:
            return rate
    return Fraction(frames_per_second).limit_denominator(1001)


@dataclass(frozen=True, eq=False)
class StoredImage:
    """An image as its file holds it.

    Attributes:
        names: Channel names, in the file's order.
        depths: Pixel type of each channel (``half``, ``float``, ``uint8``, …).
        pixels: Values as float32, top row first, shape [h, w, channels].
        metadata: Attributes, by the names and types that :func:`write_frame` takes.
        window: Where the pixels lie: column and row of the first, then the display window's column, row, width, height.
        parts: Images in the file; this is the first.
    """

    names: tuple[str, ...]
    depths: tuple[str, ...]
    pixels: np.ndarray
    metadata: dict[str, Any]
    window: tuple[int, ...]
    parts: int


def read_stored(path: str | os.PathLike[str]) -> StoredImage:
    """Reads all of an image: channels with their types, and attributes.

    Values are what the file holds (PNG, JPEG and TIFF: encoded, in 0 … 1, colours not multiplied by alpha). Attributes
    of EXR have the names and types that :func:`write_frame` takes, matrices as [4, 4] arrays.

    Raises:
        InputError: The file is missing, damaged or no image.
    """
    as_stored = oiio.ImageSpec()
    as_stored.attribute("oiio:UnassociatedAlpha", 1)
    source = oiio.ImageInput.open(os.fspath(path), as_stored)
    if source is None:
        raise InputError(f"cannot be read: {shortened(oiio.geterror())}", file=os.fspath(path))
    spec = source.spec()
    refuse_gigantic(spec, path)
    pixels = source.read_image(0, 0, 0, spec.nchannels, "float")
    if pixels is None:
        raise InputError(f"cannot be read: {shortened(source.geterror())}", file=os.fspath(path))
    parts = 1
    while source.seek_subimage(parts, 0):
        parts += 1
    source.close()
    metadata = attributes_of(spec)
    depths = tuple(str(spec.channelformat(index)) for index in range(spec.nchannels))
    window = (spec.x, spec.y, spec.full_x, spec.full_y, spec.full_width, spec.full_height)
    return StoredImage(tuple(spec.channelnames), depths, pixels, metadata, window, parts)


def memory_need(spec: oiio.ImageSpec) -> int:
    """Bytes that an image needs by what its header declares."""
    return spec.image_pixels() * spec.nchannels * 4 * IMAGE_COPIES


def refuse_gigantic(spec: oiio.ImageSpec, path: str | os.PathLike[str]) -> None:
    """Refuses an image, before any of its pixels is read, whose header declares more than memory has room for.

    Raises:
        InputError: It does.
    """
    need, allowed = memory_need(spec), memory_allowed(None)
    if need > allowed:
        raise InputError(
            f"declares {spec.width} × {spec.height} pixels of {spec.nchannels} channels, which would need "
            f"{need / 2**30:.3g} GB of memory ({allowed / 2**30:.3g} may be taken)",
            file=os.fspath(path),
        )


def read_metadata(path: str | os.PathLike[str]) -> dict[str, Any]:
    """All attributes of an image, of which only the header is read; see :func:`read_stored`.

    Raises:
        InputError: The file is missing, damaged or no image.
    """
    source = oiio.ImageInput.open(os.fspath(path))
    if source is None:
        raise InputError(f"cannot be read: {shortened(oiio.geterror())}", file=os.fspath(path))
    metadata = attributes_of(source.spec())
    source.close()
    return metadata


def attributes_of(spec: oiio.ImageSpec) -> dict[str, Any]:
    """The attributes of an image's header, by the names and types that :func:`set_attribute` takes."""
    file_names = {own: name for name, own in ATTRIBUTE_NAMES.items()}
    return {
        file_names.get(entry.name, entry.name): attribute_value(entry.type, entry.value)
        for entry in spec.extra_attribs
    }


def read_image(path: str | os.PathLike[str]) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """All channels, as float32, shape [h, w], and all attributes of an image; see :func:`read_stored`.

    Raises:
        InputError: The file is missing, damaged or no image.
    """
    stored = read_stored(path)
    planes = {name: np.ascontiguousarray(stored.pixels[..., index]) for index, name in enumerate(stored.names)}
    return planes, stored.metadata


def attribute_value(kind: oiio.TypeDesc, value: Any) -> Any:
    """An attribute of an image's header as the Python value that :func:`set_attribute` takes for it."""
    if kind == oiio.TypeDesc("matrix"):
        return np.array(value, dtype=np.float64).reshape(4, 4)
    if kind == oiio.TypeDesc("rational"):
        return value[0] / value[1]
    return value


def flip_difference(
    image: np.ndarray, baseline: np.ndarray, maximum_luminance: float, median_luminance: float
) -> np.ndarray:
    """HDR-ꟻLIP: how strongly an eye flipping between two images sees a difference, 0 … 1, shape [h, w].

    Args:
        image, baseline: Linear Rec.709, shape [h, w, 3].
        maximum_luminance, median_luminance: What the exposures are laid out over. They are given, and not measured
            from the baseline, so that the same difference has the same value in every frame.

    Raises:
        FrameError: The images cannot be compared.
    """
    found = oiio.ImageBufAlgo.FLIP_diff(
        oiio.ImageBuf(np.ascontiguousarray(baseline, dtype=np.float32)),
        oiio.ImageBuf(np.ascontiguousarray(image, dtype=np.float32)),
        hdr=1,
        maxluminance=maximum_luminance,
        medianluminance=median_luminance,
        nthreads=1,
    )
    if found.has_error:
        raise FrameError(f"FLIP failed: {found.geterror()}")
    return np.asarray(found.get_pixels("float"))[..., 0]


def decode_srgb(pixels: np.ndarray) -> np.ndarray:
    """sRGB as linear Rec.709, shape [h, w, 3]."""
    image = oiio.ImageBuf(np.ascontiguousarray(pixels, dtype=np.float32))
    image = oiio.ImageBufAlgo.colorconvert(image, "sRGB", "lin_rec709", unpremult=False, colorconfig=COLOR_CONFIG)
    if image.has_error:
        raise FrameError(f"sRGB decoding failed: {image.geterror()}")
    return np.asarray(image.get_pixels("float"))


def encoded_picture(pixels: np.ndarray, extension: str, quality: int = 85) -> bytes:
    """A small picture as the bytes of a ``.png`` or ``.jpg`` file, for pages that carry their pictures with them.

    Args:
        pixels: Values as they are stored, uint8, shape [h, w] or [h, w, 3].
        extension: ``.png`` or ``.jpg``.
        quality: Of JPEG, in percent.

    Raises:
        FrameError: It cannot be encoded.
    """
    planes = pixels if pixels.ndim == 3 else pixels[..., None]
    spec = oiio.ImageSpec(planes.shape[1], planes.shape[0], planes.shape[2], "uint8")
    spec.attribute("compression", f"jpeg:{quality}" if extension == ".jpg" else "zip:9")
    spec.attribute("jpeg:subsampling", "4:4:4")
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, f"picture{extension}")
        write_pixels(path, path, spec, np.ascontiguousarray(planes))
        return Path(path).read_bytes()


def with_text(pixels: np.ndarray, lines: Sequence[tuple[int, int, str]], size: int) -> np.ndarray:
    """A picture with lines of white text drawn on it, in OpenImageIO's default font.

    Args:
        pixels: Values as they are stored, uint8, shape [h, w, 3].
        lines: Column and row of the left end of each base line, and its text.
        size: Height of the letters in pixels.

    Returns:
        A new picture; without the text where no font is installed.
    """
    image = oiio.ImageBuf(np.ascontiguousarray(pixels))
    for column, row, text in lines:
        oiio.ImageBufAlgo.render_text(image, column, row, text, size, "", (1.0, 1.0, 1.0))
    return np.array(image.get_pixels("uint8")).reshape(pixels.shape)


@dataclass(frozen=True, eq=False)
class TextureFile:
    """An image that is spread over a surface.

    Attributes:
        pixels: Linear R, G, B and A (1 without alpha; grey gives R = G = B), rows from the top, shape [h, w, 4]
            float32.
        wrap_modes: How it goes on beyond its edges along s and t, as the file says; empty where it does not.
    """

    pixels: np.ndarray
    wrap_modes: tuple[str, str]


def read_texture(path: str | os.PathLike[str], encoding: str = "auto") -> TextureFile | None:
    """An image's first subimage.

    Args:
        path: Image file.
        encoding: As in :func:`mean_color`.

    Returns:
        None where the file is no image that can be read.
    """
    stored = _stored_texture(path)
    if stored is None:
        return None
    pixels, spec = stored
    decoded = _is_decoded(pixels, encoding)
    planes = [_linear(pixels[..., k], decoded and k < 3) for k in range(pixels.shape[-1])]
    if len(planes) < 3:
        planes = [planes[0]] * 3 + planes[1:]
    if len(planes) < 4:
        planes.append(np.ones_like(planes[0]))
    modes = str(spec.getattribute("wrapmodes") or "").split(",")
    return TextureFile(np.stack(planes, axis=-1), (modes[0], modes[-1]))


def mean_color(path: str | os.PathLike[str], encoding: str = "auto") -> np.ndarray | None:
    """Mean of an image's first subimage, shape [4]: linear R, G, B and A (1 without alpha); grey gives R = G = B.

    Args:
        path: Image file.
        encoding: ``sRGB`` or ``raw``, or ``auto``, UsdUVTexture's rule: sRGB for three channels or more of
            eight bits.

    Returns:
        None where the file is no image that can be read.
    """
    stored = _stored_texture(path)
    if stored is None:
        return None
    pixels, _ = stored
    decoded = _is_decoded(pixels, encoding)
    means = [_channel_mean(pixels[..., k], decoded and k < 3) for k in range(pixels.shape[-1])]
    if len(means) < 3:
        means = [means[0]] * 3 + means[1:]
    return np.array(means if len(means) == 4 else [*means, 1.0])


def _stored_texture(path: str | os.PathLike[str]) -> tuple[np.ndarray, oiio.ImageSpec] | None:
    """Up to four channels [h, w, c] as they are stored: eight bits, or else float32."""
    source = oiio.ImageInput.open(os.fspath(path))
    if source is None:
        oiio.geterror()
        return None
    try:
        spec = source.spec()
        if memory_need(spec) > memory_allowed(None):
            return None
        eight_bits = spec.format == oiio.TypeDesc("uint8")
        pixels = source.read_image(0, 0, 0, min(spec.nchannels, 4), "uint8" if eight_bits else "float")
    finally:
        source.close()
    if pixels is None:
        source.geterror()
        return None
    return pixels, spec


def _is_decoded(pixels: np.ndarray, encoding: str) -> bool:
    colored = pixels.dtype == np.uint8 and pixels.shape[-1] >= 3
    return encoding == "sRGB" or (encoding == "auto" and colored)


def _linear(channel: np.ndarray, srgb: bool) -> np.ndarray:
    if channel.dtype == np.uint8:
        values = np.arange(256) / 255.0
        return (_decoded(values) if srgb else values).astype(np.float32)[channel]
    values = np.where(np.isfinite(channel), channel, 0.0).astype(np.float32)
    return _decoded(values.ravel()).reshape(values.shape).astype(np.float32) if srgb else values


def _channel_mean(channel: np.ndarray, srgb: bool) -> float:
    if channel.dtype == np.uint8:
        # 256 values are decoded, however many pixels there are.
        values = np.arange(256) / 255.0
        weights = np.bincount(channel.ravel(), minlength=256) / channel.size
        return float(weights @ (_decoded(values) if srgb else values))
    values = channel[np.isfinite(channel)].astype(np.float64)
    return float((_decoded(values) if srgb else values).mean()) if values.size else 0.0


def _decoded(values: np.ndarray) -> np.ndarray:
    return decode_srgb(np.repeat(values.reshape(1, -1, 1), 3, axis=2))[0, :, 0]
