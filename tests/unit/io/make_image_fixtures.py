#!/usr/bin/env python3
"""Writes tests/unit/io/fixtures/image: small pictures made by software that is not ours.

    python3 -m venv venv && venv/bin/pip install numpy pillow pypng opencv-python-headless imagecodecs OpenEXR
    venv/bin/python tests/unit/io/make_image_fixtures.py

Pixel values follow the formula of pattern(), which the tests repeat. For JPEG the script prints what the independent
decoder makes of each file; those numbers stand in image_files_test.cpp.
"""
import pathlib

import cv2
import imagecodecs
import numpy as np
import OpenEXR
import png
from PIL import Image, PngImagePlugin

OUT = pathlib.Path(__file__).parent / "fixtures" / "image"


def pattern(height, width, channels, modulus):
    r, c, k = np.meshgrid(np.arange(height), np.arange(width), np.arange(channels), indexing="ij")
    return (r * 7919 + c * 104729 + k * 1299709) % modulus


def smooth(height, width):
    r, c = np.meshgrid(np.arange(height), np.arange(width), indexing="ij")
    return np.stack([8 * c, 8 * r, 255 - 4 * c - 4 * r], axis=-1).clip(0, 255).astype(np.uint8)


def write_png():
    def pypng(name, array, **options):
        height, width, channels = array.shape
        with open(OUT / name, "wb") as file:
            png.Writer(width, height, **options).write(file, array.reshape(height, -1).tolist())

    pypng("gray1.png", pattern(9, 13, 1, 2), greyscale=True, bitdepth=1)
    pypng("gray2_interlaced.png", pattern(9, 13, 1, 4), greyscale=True, bitdepth=2, interlace=True)
    pypng("gray4.png", pattern(9, 13, 1, 16), greyscale=True, bitdepth=4)
    pypng("gray16.png", pattern(9, 13, 1, 65536), greyscale=True, bitdepth=16)
    pypng("gray_alpha8.png", pattern(9, 13, 2, 256), greyscale=True, alpha=True, bitdepth=8)
    pypng("rgba16_interlaced.png", pattern(9, 13, 4, 65536), greyscale=False, alpha=True, bitdepth=16, interlace=True)
    pypng("rgb8_transparent.png", pattern(9, 13, 3, 256), greyscale=False, bitdepth=8,
          transparent=tuple(int(v) for v in pattern(9, 13, 3, 256)[4, 5]))
    pypng("rgb8_gamma1.png", pattern(9, 13, 3, 256), greyscale=False, bitdepth=8, gamma=1.0)
    cv2.imwrite(str(OUT / "rgb16.png"), pattern(9, 13, 3, 65536).astype(np.uint16)[:, :, ::-1])

    palette = Image.fromarray(pattern(9, 13, 1, 5)[:, :, 0].astype(np.uint8), mode="P")
    palette.putpalette(pattern(5, 1, 3, 256).astype(np.uint8).tobytes())
    palette.save(OUT / "palette.png", bits=4)
    palette.save(OUT / "palette_transparent.png", bits=4, transparency=bytes([0, 64, 128, 192, 255]))

    text = PngImagePlugin.PngInfo()
    text.add_text("Latin", "caf\xe9")
    text.add_text("Packed", "long " * 500, zip=True)
    text.add_itxt("World", "\u03c0 \u2248 3.14159")
    text.add_itxt("PackedWorld", "\u2202" * 3000, zip=True)
    Image.fromarray(pattern(9, 13, 3, 256).astype(np.uint8)).save(OUT / "text.png", pnginfo=text)


def write_jpeg():
    picture = Image.fromarray(smooth(24, 32))
    picture.save(OUT / "baseline420.jpg", quality=90, subsampling=2)
    picture.save(OUT / "progressive444.jpg", quality=90, subsampling=0, progressive=True)
    picture.convert("L").save(OUT / "gray.jpg", quality=90)
    rows = np.broadcast_to(3 * np.arange(24)[:, None, None], (24, 32, 1))
    ink = np.concatenate([255 - smooth(24, 32), rows], axis=-1).astype(np.uint8)
    Image.fromarray(ink, mode="CMYK").save(OUT / "cmyk.jpg", quality=95, subsampling=0)
    # Adobe stores inks inverted.
    inks = 255 - ink
    (OUT / "ycck.jpg").write_bytes(imagecodecs.jpeg8_encode(np.ascontiguousarray(inks), level=95, colorspace="CMYK",
                                                            outcolorspace="YCCK", subsampling="444"))
    exif = Image.Exif()
    for orientation in range(1, 9):
        exif[0x0112] = orientation
        picture.crop((0, 0, 16, 8)).save(OUT / f"orientation{orientation}.jpg", quality=95, subsampling=0, exif=exif)

    for name in ("baseline420", "progressive444", "gray", "cmyk", "ycck"):
        path = OUT / f"{name}.jpg"
        image = Image.open(path)
        values = np.asarray(image)
        if image.mode == "CMYK":
            # Pillow hands out plain inks: light is the product of what the inks leave.
            ink = values.astype(np.float64) / 255
            values = (1 - ink[..., :3]) * (1 - ink[..., 3:]) * 255
        for row, column in ((0, 0), (5, 20), (23, 31)):
            print(name, image.mode, row, column, np.round(values[row, column], 3))


def write_exr():
    half = lambda modulus, k: (pattern(10, 12, 8, modulus)[:, :, k] / 64 - 3).astype(np.float16)
    boxes = lambda data, display: {"dataWindow": tuple(np.array(p, np.int32) for p in data),
                                   "displayWindow": tuple(np.array(p, np.int32) for p in display)}
    windows = boxes(((-2, 3), (9, 12)), ((0, 0), (15, 9)))
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, "document": "{\"radius\": 0.25}",
              **windows}
    channels = {"R": half(1024, 0), "G": half(1024, 1), "B": half(1024, 2), "A": half(1024, 3),
                "albedo.R": half(1024, 4), "albedo.G": half(1024, 5), "albedo.B": half(1024, 6),
                "depth.Z": (pattern(10, 12, 1, 65536)[:, :, 0] / 7).astype(np.float32),
                "id.Y": pattern(10, 12, 1, 65536)[:, :, 0].astype(np.uint32) * 256}
    with OpenEXR.File(header, channels) as file:
        file.write(str(OUT / "layers_windows.exr"))

    for name, compression in (("piz", OpenEXR.PIZ_COMPRESSION), ("dwab", OpenEXR.DWAB_COMPRESSION),
                              ("rle", OpenEXR.RLE_COMPRESSION)):
        values = smooth(24, 32).astype(np.float32) / 255
        with OpenEXR.File({"compression": compression, "type": OpenEXR.scanlineimage}, {"RGB": values}) as file:
            file.write(str(OUT / f"smooth_{name}.exr"))

    tiles = OpenEXR.TileDescription()
    tiles.xSize, tiles.ySize = 8, 8
    tiles.mode, tiles.roundingMode = OpenEXR.ONE_LEVEL, OpenEXR.ROUND_DOWN
    with OpenEXR.File({"compression": OpenEXR.ZIPS_COMPRESSION, "type": OpenEXR.tiledimage, "tiles": tiles},
                      {"Y": half(1024, 0)}) as file:
        file.write(str(OUT / "tiled.exr"))

    parts = []
    for index, name in enumerate(("left", "right")):
        window = boxes(((4 * index, index), (4 * index + 11, index + 9)), ((0, 0), (15, 10)))
        parts.append(OpenEXR.Part({"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **window},
                                  {"Y": half(1024, index), f"only_{name}.Z": half(1024, 2 + index)}, name))
    with OpenEXR.File(parts) as file:
        file.write(str(OUT / "multipart.exr"))

    deep = np.empty((4, 5), dtype=object)
    for r in range(4):
        for c in range(5):
            deep[r, c] = np.arange(1 + (r + c) % 3, dtype=np.float32)
    with OpenEXR.File({"compression": OpenEXR.ZIPS_COMPRESSION, "type": OpenEXR.deepscanline}, {"Z": deep}) as file:
        file.write(str(OUT / "deep.exr"))


def write_hdr():
    light = (pattern(9, 13, 3, 4096) / 16.0).astype(np.float32)
    cv2.imwrite(str(OUT / "opencv.hdr"), light[:, :, ::-1])


if __name__ == "__main__":
    OUT.mkdir(parents=True, exist_ok=True)
    write_png()
    write_jpeg()
    write_exr()
    write_hdr()
