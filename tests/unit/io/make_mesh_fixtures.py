#!/usr/bin/env python3
"""Writes fixtures/mesh/: small meshes from writers that are not ours.

    python3 -m venv venv
    venv/bin/pip install numpy==2.4.6 scipy trimesh==5.2.0 plyfile==1.1.5 pygltflib==1.16.5
    venv/bin/python make_mesh_fixtures.py

The numbers that the tests expect stand here, next to what writes them.
"""
import pathlib
import struct
import zlib

import numpy as np
import plyfile
import pygltflib as g
import trimesh

OUT = pathlib.Path(__file__).parent / "fixtures" / "mesh"
OUT.mkdir(parents=True, exist_ok=True)


def png_pixel(rgb):
    """A 1x1 PNG."""
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", 1, 1, 8, 2, 0, 0, 0))
            + chunk(b"IDAT", zlib.compress(b"\0" + bytes(rgb))) + chunk(b"IEND", b""))


def ply_all_types():
    rows = [(-1 - i, 200 + i, -1000 - i, 60000 + i, -100000 - i, 4000000000 + i, 0.5 + i, 0.1 * (i + 1))
            for i in range(3)]
    types = [("a", "i1"), ("b", "u1"), ("c", "i2"), ("d", "u2"), ("e", "i4"), ("f", "u4"), ("g", "f4"), ("h", "f8")]
    numbers = plyfile.PlyElement.describe(np.array(rows, dtype=types), "numbers")
    lists = np.empty(3, dtype=[("ids", object), ("tag", "u1")])
    lists["ids"] = [np.array([0, 1, 2], "i4"), np.array([], "i4"), np.array([7, 8, 9, 10], "i4")]
    lists["tag"] = [5, 6, 7]
    lists = plyfile.PlyElement.describe(lists, "lists", len_types={"ids": "u1"}, val_types={"ids": "i4"})
    for name, text, order in (("ascii", True, "="), ("little", False, "<"), ("big", False, ">")):
        plyfile.PlyData([numbers, lists], text=text, byte_order=order, comments=["all types"]).write(
            OUT / f"all_types_{name}.ply")


def ply_gaussians():
    names = (["x", "y", "z"] + [f"f_dc_{i}" for i in range(3)] + ["opacity"] + [f"scale_{i}" for i in range(3)]
             + [f"rot_{i}" for i in range(4)])
    data = np.zeros(5, dtype=[(n, "f4") for n in names])
    for column, name in enumerate(names):
        data[name] = column + np.arange(5) / 8
    plyfile.PlyData([plyfile.PlyElement.describe(data, "vertex")], byte_order="<").write(OUT / "gaussians.ply")


def sphere():
    mesh = trimesh.creation.icosphere(subdivisions=1, radius=0.5)
    mesh.visual.vertex_colors = np.tile([255, 188, 0, 128], (len(mesh.vertices), 1))
    mesh.export(OUT / "sphere.ply", vertex_normal=True)
    mesh.export(OUT / "sphere.obj", include_normals=True)
    mesh.export(OUT / "sphere.glb")


class Packer:
    """Buffer views and accessors of one binary blob."""

    def __init__(self, gltf):
        self.gltf, self.blob = gltf, b""

    def view(self, data, stride=None):
        self.blob += b"\0" * (-len(self.blob) % 4)
        self.gltf.bufferViews.append(g.BufferView(buffer=0, byteOffset=len(self.blob), byteLength=len(data),
                                                  byteStride=stride))
        self.blob += data
        return len(self.gltf.bufferViews) - 1

    def accessor(self, view, kind, component, count, offset=0, normalized=False, **more):
        self.gltf.accessors.append(g.Accessor(bufferView=view, type=kind, componentType=component, count=count,
                                              byteOffset=offset, normalized=normalized, **more))
        return len(self.gltf.accessors) - 1


def skinned_strip():
    """Two joints, a strip of four vertices with everything that attributes can be: interleaved, normalised, sparse."""
    gltf = g.GLTF2(asset=g.Asset(version="2.0", generator="pygltflib"))
    p = Packer(gltf)
    position = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [1, 2, 0]], "<f4")
    normal = np.tile(np.array([0, 0, 1], "<f4"), (4, 1))
    interleaved = p.view(np.hstack([position, normal]).astype("<f4").tobytes(), stride=24)
    uv = np.array([[0, 65535], [65535, 65535], [0, 0], [65535, 0]], "<u2")
    # vertices 0 and 1 follow joint 0; 2 and 3 follow joint 1 by 204/255 and joint 0 by 51/255 (the second set)
    joints0 = np.array([[0, 0, 0, 0], [0, 0, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0]], "u1")
    weights0 = np.array([[255, 0, 0, 0], [255, 0, 0, 0], [204, 0, 0, 0], [204, 0, 0, 0]], "u1")
    joints1 = np.zeros((4, 4), "<u2")
    weights1 = np.array([[0, 0, 0, 0], [0, 0, 0, 0], [13107, 0, 0, 0], [13107, 0, 0, 0]], "<u2")
    colors = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255], [51, 51, 51]], "u1")
    padded = np.zeros((4, 4), "u1")
    padded[:, :3] = colors
    attributes = g.Attributes(
        POSITION=p.accessor(interleaved, "VEC3", g.FLOAT, 4, 0, max=[1, 2, 0], min=[0, 0, 0]),
        NORMAL=p.accessor(interleaved, "VEC3", g.FLOAT, 4, 12),
        TEXCOORD_0=p.accessor(p.view(uv.tobytes()), "VEC2", g.UNSIGNED_SHORT, 4, normalized=True),
        JOINTS_0=p.accessor(p.view(joints0.tobytes()), "VEC4", g.UNSIGNED_BYTE, 4),
        WEIGHTS_0=p.accessor(p.view(weights0.tobytes()), "VEC4", g.UNSIGNED_BYTE, 4, normalized=True),
        COLOR_0=p.accessor(p.view(padded.tobytes(), stride=4), "VEC3", g.UNSIGNED_BYTE, 4, normalized=True))
    attributes.JOINTS_1 = p.accessor(p.view(joints1.tobytes()), "VEC4", g.UNSIGNED_SHORT, 4)
    attributes.WEIGHTS_1 = p.accessor(p.view(weights1.tobytes()), "VEC4", g.UNSIGNED_SHORT, 4, normalized=True)
    indices = p.accessor(p.view(np.array([0, 1, 2, 3], "u1").tobytes()), "SCALAR", g.UNSIGNED_BYTE, 4)
    # The blend shape moves only vertices 1 and 3, by (0.5, 0, 0) and (0, 0, -0.25); all others come from nowhere (zero).
    sparse = g.Sparse(
        count=2,
        indices=g.AccessorSparseIndices(bufferView=p.view(np.array([1, 3], "<u2").tobytes()), byteOffset=0,
                                        componentType=g.UNSIGNED_SHORT),
        values=g.AccessorSparseValues(bufferView=p.view(np.array([[0.5, 0, 0], [0, 0, -0.25]], "<f4").tobytes()),
                                      byteOffset=0))
    morph = p.accessor(None, "VEC3", g.FLOAT, 4, sparse=sparse, min=[0, 0, -0.25], max=[0.5, 0, 0])
    gltf.meshes = [g.Mesh(name="strip", weights=[0.125], extras={"targetNames": ["widen"]}, primitives=[
        g.Primitive(attributes=attributes, indices=indices, material=0, mode=5, targets=[{"POSITION": morph}])])]
    picture = p.view(png_pixel([10, 20, 30]))
    gltf.images = [g.Image(name="pixel", mimeType="image/png", bufferView=picture)]
    gltf.textures = [g.Texture(source=0)]
    gltf.materials = [g.Material(
        name="cloth", doubleSided=True, alphaMode="MASK", alphaCutoff=0.25, emissiveFactor=[0.5, 0, 0],
        pbrMetallicRoughness=g.PbrMetallicRoughness(
            baseColorFactor=[0.25, 0.5, 0.75, 1], metallicFactor=0.125, roughnessFactor=0.625,
            baseColorTexture=g.TextureInfo(index=0, extensions={"KHR_texture_transform": {"scale": [2, 2]}})))]
    gltf.extensionsUsed = ["KHR_texture_transform"]
    # nodes: 0 armature (turned 90 degrees about x), 1 lower, 2 upper joint, 3 the mesh
    half = np.sqrt(0.5)
    gltf.nodes = [
        g.Node(name="armature", children=[1, 3], rotation=[half, 0, 0, half]),
        g.Node(name="lower", children=[2], translation=[0.5, 0, 0]),
        g.Node(name="upper", translation=[0, 1, 0], scale=[2, 2, 2]),
        g.Node(name="body", mesh=0, skin=0)]
    bind = np.tile(np.eye(4, dtype="<f4"), (2, 1, 1))
    bind[0, 3, :3] = [-0.5, 0, 0]  # glTF matrices are column-major: the last row here is the last column there
    bind[1, 3, :3] = [-0.5, -1, 0]
    gltf.skins = [g.Skin(name="rig", joints=[1, 2], skeleton=1,
                         inverseBindMatrices=p.accessor(p.view(bind.tobytes()), "MAT4", g.FLOAT, 2))]
    times = p.accessor(p.view(np.array([0, 0.5, 2], "<f4").tobytes()), "SCALAR", g.FLOAT, 3, min=[0], max=[2])
    turn = p.view(np.array([[0, 0, 0, 32767], [0, 0, 32767, 0], [0, 0, 0, -32767]], "<i2").tobytes())
    cubic = p.view(np.arange(27, dtype="<f4").tobytes())
    weights = p.view(np.array([0, 1, 0.5], "<f4").tobytes())
    gltf.animations = [g.Animation(name="wave", samplers=[
        g.AnimationSampler(input=times, interpolation="LINEAR",
                           output=p.accessor(turn, "VEC4", g.SHORT, 3, normalized=True)),
        g.AnimationSampler(input=times, interpolation="CUBICSPLINE", output=p.accessor(cubic, "VEC3", g.FLOAT, 9)),
        g.AnimationSampler(input=times, interpolation="STEP", output=p.accessor(weights, "SCALAR", g.FLOAT, 3))],
        channels=[
            g.AnimationChannel(sampler=0, target=g.AnimationChannelTarget(node=2, path="rotation")),
            g.AnimationChannel(sampler=1, target=g.AnimationChannelTarget(node=1, path="translation")),
            g.AnimationChannel(sampler=2, target=g.AnimationChannelTarget(node=3, path="weights"))])]
    gltf.scenes, gltf.scene = [g.Scene(nodes=[0])], 0
    gltf.buffers = [g.Buffer(byteLength=len(p.blob))]
    gltf.set_binary_blob(p.blob)
    gltf.save_binary(str(OUT / "skinned_strip.glb"))


def external_files():
    """A .gltf with a .bin and a picture beside it: a fan without indices, a triangle, a node with a matrix."""
    gltf = g.GLTF2(asset=g.Asset(version="2.0"))
    p = Packer(gltf)
    fan = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [-1, 1, 0]], "<f4")
    positions = p.accessor(p.view(fan.tobytes()), "VEC3", g.FLOAT, 5, min=[-1, 0, 0], max=[1, 1, 0])
    gltf.meshes = [g.Mesh(name="fan", primitives=[
        g.Primitive(attributes=g.Attributes(POSITION=positions), mode=6),
        g.Primitive(attributes=g.Attributes(POSITION=positions), mode=0)])]
    gltf.images = [g.Image(uri="a%20pixel.png"), g.Image(uri="lost.png")]
    # Turned 90 degrees about z, scaled by (2, 3, 4), moved to (5, 6, 7); column-major.
    matrix = [0, 2, 0, 0, -3, 0, 0, 0, 0, 0, 4, 0, 5, 6, 7, 1]
    gltf.nodes = [g.Node(name="placed", mesh=0, matrix=matrix)]
    gltf.buffers = [g.Buffer(byteLength=len(p.blob), uri="external.bin")]
    (OUT / "external.bin").write_bytes(p.blob)
    (OUT / "a pixel.png").write_bytes(png_pixel([1, 2, 3]))
    gltf.save_json(str(OUT / "external.gltf"))


ply_all_types()
ply_gaussians()
sphere()
skinned_strip()
external_files()
