#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes the weights of LPIPS v0.1 from the two PyTorch files that it is made of.

    convert_lpips.py squeezenet1_1_features.pth lpips_v0.1_squeeze_lin.pth lpips_squeeze.bin
    convert_lpips.py vgg16-397923af.pth lpips_v0.1_vgg_lin.pth lpips_vgg.bin

The first line makes tools/weights/lpips_squeeze.bin, the second a file for `subview-lab eval --lpips --lpips-vgg`.
The files are torchvision's SqueezeNet 1.1 (only "features") or VGG16, and the LPIPS v0.1 linear layers, in
PyTorch's older format: five pickles, then the bytes of each storage. Nothing but the standard library is needed. Pickles
are read with a closed list of names, so a file cannot run code. The output depends on the input's numbers only.

The output, little endian:
    char magic[8] = "SVLPIPS1", uint32 bytes of a value (4), uint32 number of values, uint32 CRC-32C of the
    values, uint32 0, then the values as float32: each convolution in the network's order (SqueezeNet: 0, then
    squeeze, expand1x1, expand3x3 of the fire modules 3, 4, 6, 7, 9, 10, 11, 12) as weight [out][in][ky][kx] and
    bias [out], then the seven (VGG: five) linear layers [channels].
"""
import array
import collections
import pickle
import struct
import sys

FIRES = (3, 4, 6, 7, 9, 10, 11, 12)
LINEAR = (64, 128, 256, 384, 384, 512, 512)
VGG = (0, 2, 5, 7, 10, 12, 14, 17, 19, 21, 24, 26, 28)
VGG_LINEAR = (64, 128, 256, 512, 512)


class Reader(pickle.Unpickler):
    """Pickles of tensors: a tensor becomes (storage key, offset, sizes, strides)."""

    def find_class(self, module, name):
        if (module, name) == ("collections", "OrderedDict"):
            return collections.OrderedDict
        if (module, name) == ("torch._utils", "_rebuild_tensor_v2"):
            return lambda storage, offset, sizes, strides, *rest: (storage, offset, sizes, strides)
        if (module, name) == ("torch", "FloatStorage"):
            return "float"
        raise pickle.UnpicklingError(f"{module}.{name} was not expected")

    def persistent_load(self, pid):
        if pid[0] != "storage" or pid[1] != "float":
            raise pickle.UnpicklingError(f"{pid[:2]} was not expected")
        return pid[2]


def load(path):
    """{name: (sizes, array of floats)}; tensors must lie in memory without gaps."""
    with open(path, "rb") as f:
        if Reader(f).load() != 0x1950A86A20F9469CFC6C or Reader(f).load() != 1001:
            raise SystemExit(f"{path}: not a PyTorch file of the older format")
        Reader(f).load()
        tensors = Reader(f).load()
        storages = {}
        for key in Reader(f).load():
            (n,) = struct.unpack("<q", f.read(8))
            values = array.array("f", f.read(4 * n))
            if sys.byteorder == "big":
                values.byteswap()
            if len(values) != n:
                raise SystemExit(f"{path}: ends inside storage {key}")
            storages[key] = values
    out = {}
    for name, (key, offset, sizes, strides) in tensors.items():
        n = 1
        for size, stride in zip(reversed(sizes), reversed(strides)):
            if size > 1 and stride != n:
                raise SystemExit(f"{path}: {name} is not contiguous")
            n *= size
        out[name] = (tuple(sizes), storages[key][offset : offset + n])
    return out


def crc32c(data):
    table = []
    for i in range(256):
        for _ in range(8):
            i = i >> 1 ^ (0x82F63B78 if i & 1 else 0)
        table.append(i)
    crc = 0xFFFFFFFF
    for byte in data:
        crc = crc >> 8 ^ table[(crc ^ byte) & 255]
    return crc ^ 0xFFFFFFFF


def main():
    if len(sys.argv) != 4:
        raise SystemExit(__doc__)
    net, linear = load(sys.argv[1]), load(sys.argv[2])
    is_vgg = "features.28.weight" in net
    names = ["0"] + [f"{i}.{part}" for i in FIRES for part in ("squeeze", "expand1x1", "expand3x3")]
    if is_vgg:
        names = [f"features.{i}" for i in VGG]
        net = {name: v for name, v in net.items() if not name.startswith("classifier.")}
    values = array.array("f")
    for name in names:
        for part in ("weight", "bias"):
            values.extend(net.pop(f"{name}.{part}")[1])
    for i, n in enumerate(VGG_LINEAR if is_vgg else LINEAR):
        sizes, v = linear.pop(f"lin{i}.model.1.weight")
        if sizes != (1, n, 1, 1):
            raise SystemExit(f"lin{i} has sizes {sizes}, not (1, {n}, 1, 1)")
        values.extend(v)
    if net or linear:
        raise SystemExit(f"tensors without a place: {list(net) + list(linear)}")
    if sys.byteorder == "big":
        values.byteswap()
    data = values.tobytes()
    with open(sys.argv[3], "wb") as f:
        f.write(b"SVLPIPS1" + struct.pack("<4I", 4, len(values), crc32c(data), 0) + data)


if __name__ == "__main__":
    main()
