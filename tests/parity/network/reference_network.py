#!/usr/bin/env python3
"""The networks of ARS Studio once more, in PyTorch, written from the description alone (docs/math/network.md).

Nothing is shared with model/network: filters are plain depthwise convolutions, every concatenation is made, subbands are
transformed there and back at each level, weights are modulated one output at a time by broadcasting. Run once; the files
that it writes lie beside it, and tests/unit/model/network_parity_test.cpp reads them:

    python3 reference_network.py            # needs torch, numpy, safetensors
    python3 reference_network.py --time     # how long eager PyTorch takes for the networks of preset compact
"""
import argparse
import math
import pathlib
import time

import numpy as np
import torch
import torch.nn.functional as F
from safetensors.torch import save_file

SQRT2 = math.sqrt(2.0)
SIDE_WIDTH = 128


def width_at(side, cfg):
    full = 512 if side <= 32 else int(16384 / side * cfg["multiplier"])
    return min(512, cfg["cap"], full)


# ---------------------------------------------------------------- filters

def kernel2d(gain):
    k = torch.tensor([1.0, 3.0, 3.0, 1.0])
    k = torch.outer(k, k)
    return k / k.sum() * gain


def fir(x, kernel, up=1, down=1, pad=(0, 0)):
    """Zero insertion, padding, true convolution, decimation."""
    n, c, h, w = x.shape
    if up > 1:
        z = torch.zeros(n, c, h * up, w * up)
        z[:, :, ::up, ::up] = x
        x = z
    x = F.pad(x, (pad[0], pad[1], pad[0], pad[1]))
    weight = torch.flip(kernel, (0, 1)).expand(c, 1, *kernel.shape)
    x = F.conv2d(x, weight, groups=c)
    return x[:, :, ::down, ::down]


def inverse_haar(x):
    ll, lh, hl, hh = x.chunk(4, 1)
    n, c, h, w = ll.shape
    out = torch.zeros(n, c, 2 * h, 2 * w)
    out[:, :, 0::2, 0::2] = (ll + lh + hl + hh) / 2
    out[:, :, 0::2, 1::2] = (ll + lh - hl - hh) / 2
    out[:, :, 1::2, 0::2] = (ll - lh + hl - hh) / 2
    out[:, :, 1::2, 1::2] = (ll - lh - hl + hh) / 2
    return out


def haar(x):
    a, b = x[:, :, 0::2, 0::2], x[:, :, 0::2, 1::2]
    c, d = x[:, :, 1::2, 0::2], x[:, :, 1::2, 1::2]
    return torch.cat([(a + b + c + d) / 2, (a + b - c - d) / 2, (a - b + c - d) / 2, (a - b - c + d) / 2], 1)


def leaky(x):
    return F.leaky_relu(x, 0.2) * SQRT2


# ---------------------------------------------------------------- one dual StyleUNet

class Net:
    """Weights of one network under the names of its file, and its evaluation."""

    def __init__(self, cfg, rng):
        self.cfg, self.t = cfg, {}
        self.levels = int(math.log2(cfg["size"] // 8))
        size, levels = cfg["size"], self.levels

        def draw(name, *shape, scale=1.0, mean=0.0):
            self.t[name] = weights(rng.standard_normal(shape) * scale + mean)

        style = cfg["style"]
        for i in (1, 2):
            draw(f"style.{i}.weight", style, style, scale=100)
            draw(f"style.{i}.bias", style, scale=10)
        w = lambda side: width_at(side, cfg)
        draw("conv_in.1.weight", w(size // 2), cfg["inputs"], 3, 3)
        draw("conv_in.2.bias", w(size // 2), scale=0.3)
        for i in range(levels - 1):
            here, there = w(size >> (i + 1)), w(size >> (i + 2))
            draw(f"from_rgbs.{i}.conv.0.weight", here, cfg["inputs"], 1, 1)
            draw(f"from_rgbs.{i}.conv.1.bias", here, scale=0.3)
            draw(f"cond_convs.{i}.conv1.0.weight", here, here, 3, 3)
            draw(f"cond_convs.{i}.conv1.1.bias", here, scale=0.3)
            draw(f"cond_convs.{i}.conv2.1.weight", there, here, 3, 3)
            draw(f"cond_convs.{i}.conv2.2.bias", there, scale=0.3)
        for i in range(levels):
            here = w(size >> (i + 1))
            draw(f"comb_convs.{i}.0.weight", here, here * (2 if i + 1 < levels else 1), 3, 3)
            draw(f"comb_convs.{i}.1.bias", here, scale=0.3)

        def styled(name, cin, cout):
            draw(f"{name}.conv.weight", 1, cout, cin, 3, 3)
            draw(f"{name}.conv.modulation.weight", cin, style)
            draw(f"{name}.conv.modulation.bias", cin, scale=0.3, mean=1)
            draw(f"{name}.noise.weight", 1, scale=0.3)
            draw(f"{name}.activate.bias", cout, scale=0.3)

        def torgb(name, cin, channels):
            draw(f"{name}.conv.weight", 1, 4 * channels, cin, 1, 1)
            draw(f"{name}.conv.modulation.weight", cin, style)
            draw(f"{name}.conv.modulation.bias", cin, scale=0.3, mean=1)
            draw(f"{name}.bias", 1, 4 * channels, 1, 1, scale=0.3)

        copied = cfg["copied"]
        for s in (1, 2):
            for k in range(levels):
                cin, cout = w(8 << k), w(16 << k)
                styled(f"convs{s}.{2 * k}", cin, cout)
                styled(f"convs{s}.{2 * k + 1}", cout, cout)
                torgb(f"to_rgbs{s}.{k}", cout, cfg["outputs"] - (copied if k + 1 == levels else 0))
        for n in range(2 * levels):
            draw(f"noises.noise_{n}", 1, 1, 16 << (n // 2), 16 << (n // 2))
        cin, cout = w(size // 2), w(size)
        if copied:
            draw("color_comb.0.weight", cin, 2 * cin, 3, 3)
            draw("color_comb.1.bias", cin, scale=0.3)
            for s in (1, 2):
                styled(f"color_convs{s}.0", cin, cout)
                styled(f"color_convs{s}.1", cout, cout)
                torgb(f"color_to_rgbs{s}.0", cout, copied)
        if cin != SIDE_WIDTH:
            if cfg["priors"]:
                draw("prior_projection.weight", cin, SIDE_WIDTH, 1, 1)
            if cfg["view"]:
                draw("view_projection.weight", cin, SIDE_WIDTH, 1, 1)

    def equal_conv(self, x, weight, bias, **kw):
        w = self.t[weight]
        y = F.conv2d(x, w / math.sqrt(w[0].numel()), **kw)
        return leaky(y + self.t[bias].view(1, -1, 1, 1))

    def blurred_stride(self, x, weight, bias):
        return self.equal_conv(fir(x, kernel2d(1), pad=(2, 2)), weight, bias, stride=2)

    def style_vector(self):
        z = torch.ones(self.cfg["style"]) / math.sqrt(self.cfg["style"])
        z = z / torch.sqrt((z * z).mean() + 1e-8)
        for i in (1, 2):
            w, b = self.t[f"style.{i}.weight"], self.t[f"style.{i}.bias"]
            z = leaky(F.linear(z, w * 0.01 / math.sqrt(w.shape[1]), b * 0.01))
        return z

    def modulated(self, name, demodulate):
        w = self.t[f"{name}.conv.weight"][0]
        m = self.t[f"{name}.conv.modulation.weight"]
        s = F.linear(self.style_vector(), m / math.sqrt(m.shape[1]), self.t[f"{name}.conv.modulation.bias"])
        w = w / math.sqrt(w[0].numel()) * s.view(1, -1, 1, 1)
        if demodulate:
            w = w / torch.sqrt((w * w).sum(dim=(1, 2, 3), keepdim=True) + 1e-8)
        return w

    def styled(self, name, noise, x, up):
        w = self.modulated(name, True)
        if up:
            x = F.conv_transpose2d(x, w.permute(1, 0, 2, 3), stride=2)
            x = fir(x, kernel2d(4), pad=(1, 1))
        else:
            x = F.conv2d(x, w, padding=1)
        x = x + self.t[f"{name}.noise.weight"] * self.t[f"noises.noise_{noise}"]
        return leaky(x + self.t[f"{name}.activate.bias"].view(1, -1, 1, 1))

    def torgb(self, name, x, skip):
        out = F.conv2d(x, self.modulated(name, False)) + self.t[f"{name}.bias"]
        if skip is None:
            return out
        return out + haar(fir(inverse_haar(skip), kernel2d(4), up=2, pad=(2, 1)))

    def side_feature(self, f, name):
        f = F.interpolate(f, scale_factor=2, mode="bilinear", align_corners=False)
        if name in self.t:
            f = F.conv2d(f, self.t[name] / math.sqrt(SIDE_WIDTH))
        return f

    def run(self, maps, priors=None, views=None):
        """(1, 2 C, 2 S, 2 S); priors and views: two features (1, 128, S/4, S/4) each."""
        cfg, levels, copied = self.cfg, self.levels, self.cfg["copied"]
        skips = [self.blurred_stride(maps, "conv_in.1.weight", "conv_in.2.bias")]
        picture, x = maps, skips[0]
        for i in range(levels - 1):
            picture = fir(picture, kernel2d(1), down=2, pad=(1, 1))
            x = x + self.equal_conv(picture, f"from_rgbs.{i}.conv.0.weight", f"from_rgbs.{i}.conv.1.bias")
            x = self.equal_conv(x, f"cond_convs.{i}.conv1.0.weight", f"cond_convs.{i}.conv1.1.bias", padding=1)
            x = self.blurred_stride(x, f"cond_convs.{i}.conv2.1.weight", f"cond_convs.{i}.conv2.2.bias")
            skips.append(x)
        sides = []
        for s in (0, 1):
            x, image = None, None
            for k in range(levels):
                last, i = k + 1 == levels, levels - 1 - k
                if last:
                    if priors is not None:
                        x = x + self.side_feature(priors[s], "prior_projection.weight")
                    seen = x if views is None else x + self.side_feature(views[s], "view_projection.weight")
                    if copied:
                        y = self.equal_conv(torch.cat([seen, skips[0]], 1), "color_comb.0.weight", "color_comb.1.bias",
                                            padding=1)
                        y = self.styled(f"color_convs{s + 1}.0", 2 * k, y, True)
                        y = self.styled(f"color_convs{s + 1}.1", 2 * k + 1, y, False)
                        keep, split = cfg["outputs"] - copied, image.chunk(4, 1)
                        colors = self.torgb(f"color_to_rgbs{s + 1}.0", y, torch.cat([b[:, keep:] for b in split], 1))
                        image = torch.cat([b[:, :keep] for b in split], 1)
                    else:
                        x = seen
                x = skips[-1] if k == 0 else torch.cat([x, skips[i]], 1)
                x = self.equal_conv(x, f"comb_convs.{i}.0.weight", f"comb_convs.{i}.1.bias", padding=1)
                x = self.styled(f"convs{s + 1}.{2 * k}", 2 * k, x, True)
                x = self.styled(f"convs{s + 1}.{2 * k + 1}", 2 * k + 1, x, False)
                image = self.torgb(f"to_rgbs{s + 1}.{k}", x, image)
            sides.append(inverse_haar(image))
            if copied:
                sides.append(inverse_haar(colors))
        return torch.cat(sides, 1)


class Encoder:
    def __init__(self, channels, rng):
        self.t = {}
        for i, (cin, cout) in enumerate([(channels, 64), (64, SIDE_WIDTH)]):
            self.t[f"{2 * i}.weight"] = weights(rng.standard_normal((cout, cin, 4, 4)) / math.sqrt(16 * cin))
            self.t[f"{2 * i}.bias"] = weights(rng.standard_normal(cout) * 0.3)

    def run(self, x):
        x = F.leaky_relu(F.conv2d(x, self.t["0.weight"], self.t["0.bias"], stride=2, padding=1), 0.2)
        x = F.conv2d(x, self.t["2.weight"], self.t["2.bias"], stride=2, padding=1)
        return [x[:1], x[1:]]


# ---------------------------------------------------------------- cases

SMALL = dict(size=64, multiplier=0.0234375, cap=8, style=16, copied=0, priors=False, view=False)


def weights(values):
    """Float tensor of numbers that bfloat16 holds exactly, so that files may keep them so."""
    return torch.from_numpy(np.asarray(values, np.float32)).bfloat16().float()


def put(file, prefix, tensors, exact=False):
    for name, value in tensors.items():
        file[prefix + name] = (value.bfloat16() if exact else value).contiguous()


def picture_like(rng, *shape):
    """Smooth, of the size that metric positions have, 0 outside a disc, as position maps are."""
    x = rng.standard_normal(shape).astype(np.float32)
    x = F.avg_pool2d(torch.from_numpy(x), 5, stride=1, padding=2) * 3
    v, u = torch.meshgrid(torch.arange(shape[-2]) + 0.5, torch.arange(shape[-1]) + 0.5, indexing="ij")
    inside = ((u / shape[-1] - 0.5) ** 2 + (v / shape[-2] - 0.5) ** 2) < 0.16
    return x * inside


def single_case(folder, rng, encoder):
    """One network as Animatable Gaussians' colour network: front map, view at the last level."""
    net = Net(dict(SMALL, inputs=3, outputs=3, view=True), rng)
    maps, view = picture_like(rng, 1, 3, 64, 64), picture_like(rng, 2, 1, 64, 64)
    out = net.run(maps, views=encoder.run(view))
    file = {"in.maps": maps, "in.view": view, "out": out[:, :, 1::3, ::3].contiguous()}
    put(file, "net.", net.t, exact=True)
    save_file(file, folder / "animatable_gaussians.safetensors")


def avatar_case(folder, rng, prior_encoder, view_encoder, four):
    names = dict(position=3, other=8, color=3, material=4) if four else dict(geometry=11, appearance=7)
    nets = {}
    for name, outputs in names.items():
        nets[name] = Net(dict(SMALL, inputs=6, outputs=outputs, priors=True, view=name in ("color", "appearance"),
                              copied=3 if name == "appearance" else 0), rng)
    positions, priors = picture_like(rng, 2, 3, 64, 64), picture_like(rng, 2, 5, 64, 64)
    view = picture_like(rng, 2, 1, 64, 64)
    pixels = torch.from_numpy(np.sort(rng.choice(128 * 256, 1200, replace=False)).astype(np.int64))
    features, seen = prior_encoder.run(priors), view_encoder.run(view)
    maps = torch.cat([positions[:1], positions[1:]], 1)

    def rows(name):
        cfg = nets[name].cfg
        out = nets[name].run(maps, features, seen if cfg["view"] else None)
        front, back = out.chunk(2, 1)
        both = torch.cat([front, back], 3)[0]
        return both.flatten(1).t()[pixels]

    file = {"in.positions": positions, "in.priors": priors, "in.view": view, "in.pixels": pixels}
    if four:
        other, material = rows("other"), rows("material")
        out = dict(offsets=rows("position"), opacities=other[:, :1], scales=other[:, 1:4], rotations=other[:, 4:],
                   colors=rows("color"), albedos=material[:, :3], roughnesses=material[:, 3:])
    else:
        g, a = rows("geometry"), rows("appearance")
        out = dict(offsets=g[:, :3], opacities=g[:, 3:4], scales=g[:, 4:7], rotations=g[:, 7:], albedos=a[:, :3],
                   roughnesses=a[:, 3:4], colors=a[:, 4:])
    put(file, "out.", out)
    for name, net in nets.items():
        put(file, f"net.{name}.", net.t, exact=True)
    save_file(file, folder / ("four_networks.safetensors" if four else "two_networks.safetensors"))


# ---------------------------------------------------------------- time

COMPACT = dict(size=128, multiplier=0.5, cap=64, style=512)


class TimedNetworks:
    """Both networks of preset compact with their encoders, random weights, as bench_model evaluates them."""

    def __init__(self):
        rng = np.random.default_rng(20)
        self.geometry = Net(dict(COMPACT, inputs=6, outputs=11, priors=True, view=False, copied=0), rng)
        self.appearance = Net(dict(COMPACT, inputs=6, outputs=7, priors=True, view=True, copied=3), rng)
        self.encoders = [Encoder(5, rng), Encoder(1, rng)]
        size = COMPACT["size"]
        self.inputs = [torch.randn(1, 6, size, size), torch.randn(2, 5, size, size), torch.randn(2, 1, size, size)]
        self.parts = [self.geometry, self.appearance, *self.encoders]

    def tensors(self):
        return [tensor for part in self.parts for tensor in part.t.values()]

    def convert(self, change):
        for part in self.parts:
            part.t = {name: change(tensor) for name, tensor in part.t.items()}
        self.inputs = [change(tensor) for tensor in self.inputs]

    def fold(self):
        """Modulated weights once and for all, as a network that does not train may have them."""
        for net in (self.geometry, self.appearance):
            known = {}
            fresh = net.modulated

            def folded(name, demodulate, known=known, fresh=fresh):
                if name not in known:
                    known[name] = fresh(name, demodulate)
                return known[name]

            net.modulated = folded

    def run(self):
        maps, priors, view = self.inputs
        features, seen = self.encoders[0].run(priors), self.encoders[1].run(view)
        return self.geometry.run(maps, features), self.appearance.run(maps, features, seen)


def best_of(repetitions, function):
    function()
    seconds = []
    for _ in range(repetitions):
        start = time.perf_counter()
        function()
        seconds.append(time.perf_counter() - start)
    return min(seconds)


def conv_flop(networks):
    from torch.utils.flop_counter import FlopCounterMode
    with FlopCounterMode(display=False) as counter:
        networks.run()
    return counter.get_total_flops()


def time_networks(repetitions):
    a = torch.randn(1024, 1024)
    rate = 2 * 1024 ** 3 / best_of(repetitions, lambda: a @ a)
    print(f"torch {torch.__version__}, {torch.get_num_threads()} threads, matrix product {rate * 1e-9:.0f} GFLOP/s")

    def row(name, seconds, flop=None):
        share = f", {flop / seconds * 1e-9:.0f} GFLOP/s, {100 * flop / seconds / rate:.0f} % of it" if flop else ""
        print(f"{name:44s} {seconds * 1e3:8.1f} ms{share}", flush=True)

    networks = TimedNetworks()
    with torch.no_grad():
        flop = conv_flop(networks)
        print(f"convolutions and products of one evaluation: {flop * 0.5e-9:.2f} GMAC")
        row("forward", best_of(repetitions, networks.run), flop)

    def step():
        for tensor in networks.tensors():
            tensor.grad = None
        sum(picture.mean() for picture in networks.run()).backward()

    for tensor in networks.tensors():
        tensor.requires_grad_()
    row("forward and backward", best_of(repetitions, step), 3 * flop)
    with torch.no_grad():
        networks.convert(lambda tensor: tensor.detach())
        networks.fold()
        row("folded weights, float", best_of(repetitions, networks.run), flop)
        last = TimedNetworks()
        last.convert(lambda t: t.contiguous(memory_format=torch.channels_last) if t.dim() == 4 else t)
        last.fold()
        row("folded weights, float, channels last", best_of(repetitions, last.run), flop)
        torch.set_default_dtype(torch.bfloat16)
        last = TimedNetworks()
        last.convert(lambda t: t.bfloat16().contiguous(memory_format=torch.channels_last)
                     if t.dim() == 4 else t.bfloat16())
        last.fold()
        row("folded weights, bfloat16, channels last", best_of(repetitions, last.run), flop)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", type=pathlib.Path, default=pathlib.Path(__file__).parent)
    parser.add_argument("--time", action="store_true", help="write nothing; time the networks of preset compact")
    parser.add_argument("--threads", type=int, help="with --time (default: PyTorch's own choice)")
    parser.add_argument("--repetitions", type=int, default=6, help="with --time: the best of so many counts")
    options = parser.parse_args()
    if options.time:
        if options.threads:
            torch.set_num_threads(options.threads)
        time_networks(options.repetitions)
        return
    folder = options.folder
    torch.set_num_threads(1)
    rng = np.random.default_rng(20)
    with torch.no_grad():
        prior_encoder, view_encoder = Encoder(5, rng), Encoder(1, rng)
        encoders = {}
        put(encoders, "net.prior_encoder.", prior_encoder.t, exact=True)
        put(encoders, "net.view_encoder.", view_encoder.t, exact=True)
        save_file(encoders, folder / "side_encoders.safetensors")
        single_case(folder, rng, view_encoder)
        avatar_case(folder, rng, prior_encoder, view_encoder, four=False)
        avatar_case(folder, rng, prior_encoder, view_encoder, four=True)


if __name__ == "__main__":
    main()
