#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Makes the reduced datasets of tests/data (README.md there) from the full ones.

    reduce.py SOURCE tests/data

SOURCE holds the full datasets under the names used below. Needs nothing but the standard library.
"""
import glob
import json
import os
import shutil
import struct
import sys
import zlib

WEBCAM_EXPOSURES = range(38, 50)  # sync_index; the first one recorded is 35
DEVICES = ("mono_theta0", "stereo_theta10", "phone_theta10", "lightfield_theta10", "multiplexed_theta10")


def paeth(left, up, corner):
    to_left, to_up, to_corner = abs(up - corner), abs(left - corner), abs(left + up - 2 * corner)
    if to_left <= to_up and to_left <= to_corner:
        return left
    return up if to_up <= to_corner else corner


def predict(kind, left, up, corner):
    return (0, left, up, (left + up) // 2, paeth(left, up, corner))[kind]


def read_rgba(path):
    """Rows of an 8-bit RGBA PNG without interlacing."""
    with open(path, "rb") as f:
        data = f.read()
    at, packed = 8, b""
    while at < len(data):
        n, kind = struct.unpack(">I4s", data[at:at + 8])
        if kind == b"IHDR":
            width, height, *form = struct.unpack(">IIBBBBB", data[at + 8:at + 8 + n])
            assert form == [8, 6, 0, 0, 0], path
        elif kind == b"IDAT":
            packed += data[at + 8:at + 8 + n]
        at += 12 + n
    raw, stride, rows, up = zlib.decompress(packed), 4 * width, [], bytes(4 * width)
    for y in range(height):
        kind, row = raw[y * (stride + 1)], bytearray(raw[y * (stride + 1) + 1:(y + 1) * (stride + 1)])
        for x in range(stride):
            left, corner = (row[x - 4], up[x - 4]) if x >= 4 else (0, 0)
            row[x] = (row[x] + predict(kind, left, up[x], corner)) & 255
        rows.append(row)
        up = row
    return rows


def write_rgba(path, rows):
    """Each row with the filter whose differences are smallest."""
    raw, up = b"", bytes(len(rows[0]))
    for row in rows:
        best = None
        for kind in range(5):
            out = bytearray([kind])
            for x, value in enumerate(row):
                left, corner = (row[x - 4], up[x - 4]) if x >= 4 else (0, 0)
                out.append((value - predict(kind, left, up[x], corner)) & 255)
            size = sum(min(v, 256 - v) for v in out[1:])
            if best is None or size < best[0]:
                best = size, out
        raw += best[1]
        up = row
    with open(path, "wb") as f:
        f.write(b"\x89PNG\r\n\x1a\n")
        head = struct.pack(">IIBBBBB", len(rows[0]) // 4, len(rows), 8, 6, 0, 0, 0)
        for kind, body in ((b"IHDR", head), (b"IDAT", zlib.compress(raw, 9)), (b"IEND", b"")):
            f.write(struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body)))


def halve(rows):
    """Means of 2x2 pixels. Alpha is straight: colours count in proportion to it."""
    out = []
    for a, b in zip(rows[::2], rows[1::2]):
        row = bytearray()
        for x in range(0, len(a), 8):
            pixels = (a[x:x + 4], a[x + 4:x + 8], b[x:x + 4], b[x + 4:x + 8])
            alpha = sum(p[3] for p in pixels)
            for c in range(3):
                row.append((sum(p[c] * p[3] for p in pixels) + alpha // 2) // alpha if alpha else 0)
            row.append((alpha + 2) // 4)
        out.append(row)
    return out


def write_transforms(path, t):
    """One frame a line."""
    lists = {k: v for k, v in t.items() if isinstance(v, list) and v and isinstance(v[0], dict)}
    text = json.dumps({k: v for k, v in t.items() if k not in lists})[:-1]
    for name, items in lists.items():
        text += ',\n"%s": [\n%s\n]' % (name, ",\n".join(json.dumps(i) for i in items))
    with open(path, "w") as f:
        f.write(text + "}\n")


def copy(source, names, to):
    for name in names:
        os.makedirs(os.path.dirname(os.path.join(to, name)), exist_ok=True)
        shutil.copyfile(os.path.join(source, name), os.path.join(to, name))


def reduce_mic(source, to):
    for split, count in (("train", 32), ("test", 8)):
        with open("%s/transforms_%s.json" % (source, split)) as f:
            t = json.load(f)
        t.pop("ray_distance_unit")
        t["frames"] = [t["frames"][i * len(t["frames"]) // count] for i in range(count)]
        os.makedirs("%s/%s" % (to, split), exist_ok=True)
        for frame in t["frames"]:
            frame.pop("ray_distance_path", None)
            write_rgba("%s/%s.png" % (to, frame["file_path"]),
                       halve(read_rgba("%s/%s.png" % (source, frame["file_path"]))))
        write_transforms("%s/transforms_%s.json" % (to, split), t)


def reduce_kitchen(source, to):
    """The first exposure of each device, and the views near it that no device has."""
    names = ["transforms_test_near.json"] + ["transforms_train_%s.json" % d for d in DEVICES]
    for name in names:
        with open("%s/%s" % (source, name)) as f:
            t = json.load(f)
        t.pop("ply_file_path")  # points that were seen from other exposures, too
        lists = [key for key in ("frames", "composites", "composites_linear") if key in t]
        for key in lists:
            t[key] = [i for i in t[key] if i["exposure"] <= 0]
        paths = {i.get(key) for part in lists for i in t[part] for key in ("file_path", "depth_path")}
        copy(source, paths - {None}, to)
        write_transforms("%s/%s" % (to, name), t)


def reduce_webcams(source, to):
    with open(source + "/timestamps.csv") as f:
        head, *rows = f.read().splitlines()
    chosen = [row for row in rows if int(row.split(",")[0]) in WEBCAM_EXPOSURES]
    for camera in range(4):
        times = sorted(float(r.split(",")[2]) for r in rows if r.split(",")[1] == str(camera))
        mine = {float(r.split(",")[2]) for r in chosen if r.split(",")[1] == str(camera)}
        pictures = sorted(os.listdir("%s/cam%d" % (source, camera)))
        assert len(pictures) == len(times)
        copy(source, ["cam%d/%s" % (camera, p) for p, t in zip(pictures, times) if t in mine], to)
    copy(source, ["LICENSE", "camera_array.toml"], to)
    shutil.copyfile(source + "/timestamps.csv", to + "/timestamps_all.csv")
    with open(to + "/timestamps.csv", "w") as f:
        f.write("\n".join([head] + chosen) + "\n")


def main(source, to):
    reduce_mic(source + "/nerf_mic_400", to + "/mic_200")
    reduce_kitchen(source + "/blender_kitchen", to + "/kitchen")
    reduce_webcams(source + "/replay_4cam_board", to + "/webcams_board")
    boards = source + "/calib_stereo_chessboard"
    copy(boards, [os.path.basename(p) for p in glob.glob(boards + "/*.jpg")] + ["intrinsics.yml"],
         to + "/stereo_chessboard")
    stills = source + "/replay_4cam_person"
    copy(stills + "/chessboard", os.listdir(stills + "/chessboard"), to + "/qca_chessboard")
    copy(stills, ["LICENSE"], to + "/qca_chessboard")
    weights = source + "/weights"
    copy(weights + "/lpips_examples", os.listdir(weights + "/lpips_examples"), to + "/lpips_examples")
    shutil.copyfile(weights + "/lpips_LICENSE", to + "/lpips_examples/LICENSE")


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
