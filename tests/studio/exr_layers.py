"""The layers of an EXR file as the program writes them: scan lines, uncompressed or ZIP. Bits are compared, not values.
"""
import itertools
import struct
import zlib

BYTES = {0: 4, 1: 2, 2: 4}  # uint, half, float


class Layers:
    """`lines[layer][row][channel]`: bytes of a row. The layer without a name is called "beauty"."""

    def __init__(self, path):
        data = open(path, "rb").read()
        assert data[:4] == b"\x76\x2f\x31\x01", f"{path} is no EXR"
        assert struct.unpack_from("<I", data, 4)[0] & 0x1A00 == 0, "expected one part of scan lines"
        attributes, position = self.attributes(data, 8)
        x0, y0, x1, y1 = struct.unpack("<4i", attributes["dataWindow"])
        self.width, self.height = x1 - x0 + 1, y1 - y0 + 1
        compression = attributes["compression"][0]
        assert compression in (0, 2, 3), f"compression {compression} is not read here"
        rows = 16 if compression == 3 else 1
        self.channels = self.channel_list(attributes["channels"])
        self.lines = {layer: [{} for _ in range(self.height)] for layer in {c[0] for c in self.channels}}
        for block in range((self.height + rows - 1) // rows):
            offset = struct.unpack_from("<Q", data, position + 8 * block)[0]
            first, size = struct.unpack_from("<iI", data, offset)
            count = min(rows, self.height - (first - y0))
            whole = count * self.width * sum(c[2] for c in self.channels)
            self.take(self.unpacked(data[offset + 8:offset + 8 + size], whole), first - y0, count)

    @staticmethod
    def attributes(data, position):
        found = {}
        while data[position]:
            name_end = data.index(b"\0", position)
            type_end = data.index(b"\0", name_end + 1)
            size = struct.unpack_from("<I", data, type_end + 1)[0]
            found[data[position:name_end].decode()] = data[type_end + 5:type_end + 5 + size]
            position = type_end + 5 + size
        return found, position + 1

    @staticmethod
    def channel_list(data):
        """(layer, letter, bytes of a pixel), in the file's order."""
        found, position = [], 0
        while data[position]:
            end = data.index(b"\0", position)
            layer, _, letter = data[position:end].decode().rpartition(".")
            found.append((layer or "beauty", letter, BYTES[struct.unpack_from("<i", data, end + 1)[0]]))
            position = end + 17
        return found

    @staticmethod
    def unpacked(block, size):
        if len(block) == size:
            return block
        differences = zlib.decompress(block)
        halves = bytes(itertools.accumulate(differences, lambda a, b: (a + b - 128) & 255))
        assert len(halves) == size
        joined = bytearray(size)
        joined[0::2], joined[1::2] = halves[:(size + 1) // 2], halves[(size + 1) // 2:]
        return bytes(joined)

    def take(self, block, first, count):
        position = 0
        for row in range(first, first + count):
            for layer, letter, size in self.channels:
                self.lines[layer][row][letter] = block[position:position + size * self.width]
                position += size * self.width

    def covered(self):
        """Pixels where something of the avatar is."""
        return sum(1 for row in self.lines["opacity"] for line in row.values()
                   for x in range(self.width) if any(line[x * len(line) // self.width:(x + 1) * len(line) // self.width]))

    def difference(self, other, layer):
        """Pixels of a layer whose bits differ: (x, y)."""
        assert (self.width, self.height) == (other.width, other.height), "pictures of different sizes"
        found = set()
        for y, (a, b) in enumerate(zip(self.lines[layer], other.lines[layer])):
            for letter, line in a.items():
                if line == b[letter]:
                    continue
                size = len(line) // self.width
                found |= {(x, y) for x in range(self.width)
                          if line[x * size:(x + 1) * size] != b[letter][x * size:(x + 1) * size]}
        return found

    def steps(self, other, layer, pixel):
        """How far apart the numbers of a pixel are at most, in steps of the file's own kind of number (half, float)."""
        x, y = pixel
        most = 0
        for letter, line in self.lines[layer][y].items():
            size = len(line) // self.width
            places = [ordered(row[x * size:(x + 1) * size]) for row in (line, other.lines[layer][y][letter])]
            most = max(most, abs(places[0] - places[1]))
        return most


def ordered(number):
    """A place among all numbers of its kind: neighbours differ by one, and -0 stands where 0 does."""
    bits = int.from_bytes(number, "little")
    sign = 1 << (8 * len(number) - 1)
    return sign - bits if bits & sign else bits
