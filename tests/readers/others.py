"""Says as JSON what programs that are not here would have against a recording: by the rules of the MCAP format that `mcap doctor` looks at, by what Foxglove
asks of JSON channels and of the three schemas that it knows, and by what PlotJuggler's loader does; and which curves PlotJuggler has of it. Each rule stands
beside where it is from. Read with the `mcap` package of PyPI and nothing of ours. For tests/reader.rs; by hand: `PYTHONPATH=target/reader python3
tests/readers/others.py FILE`."""

import base64
import json
import math
import struct
import sys

from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, Message, MessageIndex, Metadata, Schema
from mcap.stream_reader import StreamReader, get_chunk_data_stream

HEAD_BYTES = 9  # opcode and length of a record
FOOTER_BYTES = 20 + 8  # its body and the magic behind it
MOST_TOLD = 20

# foxglove/foxglove-sdk, schemas/jsonschema: what of each is required.
TIME = {"sec": int, "nsec": int}
XYZ = {"x": float, "y": float, "z": float}
KNOWN = {
    "foxglove.PoseInFrame": {"timestamp": TIME, "frame_id": str, "pose": {"position": XYZ, "orientation": {**XYZ, "w": float}}},
    "foxglove.Log": {"timestamp": TIME, "level": int, "message": str, "name": str, "file": str, "line": int},
    "foxglove.CompressedImage": {"timestamp": TIME, "frame_id": str, "data": str, "format": str},
}
LEVELS = range(6)  # unknown, debug, info, warning, error, fatal
FORMATS = {"jpeg": b"\xff\xd8\xff", "png": b"\x89PNG"}


def of_chunk(chunk):
    """Schemas, channels and messages of a chunk, each with its place in what is compressed."""
    stream, length = get_chunk_data_stream(chunk, validate_crc=True)
    kinds = {Opcode.SCHEMA: lambda _: Schema.read(stream), Opcode.CHANNEL: lambda _: Channel.read(stream),
             Opcode.MESSAGE: lambda size: Message.read(stream, size)}
    while stream.count < length:
        at, kind, size = stream.count, stream.read1(), stream.read8()
        yield at, kinds[kind](size)


class Doctor:
    """The format's own rules, as foxglove/mcap go/cli/mcap/cmd/doctor.go looks at them: a chunk has the times of its messages, an index names each of them
    with its time and its place, who is named was introduced, and an id means one thing."""

    def __init__(self, complain):
        self.complain, self.known, self.counts, self.chunks, self.metadata = complain, {}, {}, 0, 0
        self.messages, self.indexed, self.span = {}, {}, None

    def introduce(self, record):
        known = self.known.setdefault((type(record), record.id), record)
        if known != record:
            self.complain(f"{type(record).__name__} {record.id} means two things")
        if isinstance(record, Channel) and (Schema, record.schema_id) not in self.known:
            self.complain(f"{record.topic} has a schema that is not there")

    def settle(self):
        if self.messages != self.indexed:
            self.complain("what the indexes of a chunk name is not what is in it")
        self.messages, self.indexed = {}, {}

    def chunk(self, chunk):
        self.chunks += 1
        for at, record in of_chunk(chunk):
            if not isinstance(record, Message):
                self.introduce(record)
                continue
            if (Channel, record.channel_id) not in self.known:
                self.complain(f"a message of the channel {record.channel_id}, which is not there")
            self.messages.setdefault(record.channel_id, []).append((record.log_time, at))
            self.counts[record.channel_id] = self.counts.get(record.channel_id, 0) + 1
        times = [time for of_channel in self.messages.values() for time, _ in of_channel]
        if times and (min(times), max(times)) != (chunk.message_start_time, chunk.message_end_time):
            self.complain(f"a chunk from {min(times)} to {max(times)} says {chunk.message_start_time} to {chunk.message_end_time}")
        ends = times + list(self.span or ())
        self.span = (min(ends), max(ends)) if ends else None

    def read(self, path):
        with open(path, "rb") as file:
            for record in StreamReader(file, emit_chunks=True, validate_crcs=True).records:
                if isinstance(record, MessageIndex):
                    entries = [tuple(entry) for entry in record.records]
                    self.indexed.setdefault(record.channel_id, []).extend(entries)
                    continue
                self.settle()
                if isinstance(record, Chunk):
                    self.chunk(record)
                elif isinstance(record, (Schema, Channel)):
                    self.introduce(record)
                self.metadata += isinstance(record, Metadata)
        self.settle()

    def compare(self, statistics):
        """What the summary says of all that is there."""
        said = (statistics.channel_message_counts, statistics.message_count, statistics.chunk_count, statistics.metadata_count,
                (statistics.message_start_time, statistics.message_end_time))
        found = (self.counts, sum(self.counts.values()), self.chunks, self.metadata, self.span)
        if {id: count for id, count in said[0].items() if count} != found[0] or said[1:] != found[1:]:
            self.complain(f"the summary counts {said[1:]}, there is {found[1:]}")


def head_at(file, at):
    """Opcode and whole length of the record at a byte."""
    file.seek(at)
    opcode, length = struct.unpack("<BQ", file.read(HEAD_BYTES))
    return opcode, length + HEAD_BYTES


def places(file, summary, complain):
    """What the summary names lies where it says so."""
    for chunk in summary.chunk_indexes:
        if head_at(file, chunk.chunk_start_offset) != (Opcode.CHUNK, chunk.chunk_length):
            complain(f"there is no such chunk at byte {chunk.chunk_start_offset}")
        for channel, at in chunk.message_index_offsets.items():
            if head_at(file, at)[0] != Opcode.MESSAGE_INDEX or struct.unpack("<H", file.read(2))[0] != channel:
                complain(f"there is no index of channel {channel} at byte {at}")
    for metadata in summary.metadata_indexes:
        if head_at(file, metadata.offset) != (Opcode.METADATA, metadata.length):
            complain(f"there is no such metadata at byte {metadata.offset}")


def groups(file, complain):
    """PlotJuggler's DataLoadMCAP (dataload_mcap.cpp) reads schemas, channels and statistics by the summary's offsets, and skips the rest."""
    file.seek(-FOOTER_BYTES, 2)
    start, offsets, _ = struct.unpack("<QQI", file.read(20))
    end, found = file.tell() - 20 - HEAD_BYTES, {}
    at = offsets
    while start < offsets <= at < end:
        opcode, length = head_at(file, at)
        if opcode == Opcode.SUMMARY_OFFSET:
            group, first, group_bytes = struct.unpack("<BQQ", file.read(17))
            found[group] = (first, first + group_bytes)
        at += length
    for kind in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.STATISTICS):
        at, end = found.get(kind, (0, 0))
        if at == end:
            complain(f"PlotJuggler finds no {Opcode(kind).name} by the summary's offsets")
        while at < end:
            opcode, length = head_at(file, at)
            if opcode != kind:
                complain(f"PlotJuggler finds a record of another kind among those of {Opcode(kind).name}")
            at += length


def refused(schema, where):
    """What Foxglove's reader refuses of a JSON schema (foxglove/studio, packages/mcap-support/src/parseJsonSchema.ts): of such a channel it shows nothing."""
    if schema.get("type") != "object" or not isinstance(schema.get("properties"), dict):
        return f"{where} is no object with properties"
    for name, field in schema["properties"].items():
        at, kind = f"{where}.{name}", field.get("type")
        if not isinstance(kind, str) or kind not in ("boolean", "string", "number", "integer", "object", "array"):
            return f"{at} is of type {kind!r}"
        if kind == "string" and field.get("contentEncoding", "base64") != "base64":
            return f"{at} has another encoding than base64"
        if kind == "array":
            items = field.get("items", {})
            if items.get("type") not in ("boolean", "string", "number", "integer", "object") or "contentEncoding" in items:
                return f"{at} is an array of what Foxglove knows none of"
        inner = field if kind == "object" else field.get("items", {}) if kind == "array" else {}
        found = refused(inner, at) if inner.get("type") == "object" else None
        if found:
            return found
    return None


def lacks(value, required, where):
    """What a message has not that its schema requires; a number that is not finite is not there."""
    for name, kind in required.items():
        found = value.get(name)
        if isinstance(kind, dict):
            missing = lacks(found, kind, f"{where}.{name}") if isinstance(found, dict) else f"{where}.{name} is not there"
        else:
            kinds = (int, float) if kind is float else kind
            missing = None if isinstance(found, kinds) and not isinstance(found, bool) else f"{where}.{name} is {found!r}"
        if missing:
            return missing
    return None


def known(name, value, time_ns):
    """What is wrong with a message of a schema that Foxglove knows."""
    missing = lacks(value, KNOWN[name], name)
    if missing:
        return missing
    stamp = value["timestamp"]
    if not 0 <= stamp["nsec"] < 10**9 or stamp["sec"] * 10**9 + stamp["nsec"] != time_ns:
        return f"{name} of {stamp} lies at {time_ns} ns"
    if name == "foxglove.Log" and value["level"] not in LEVELS:
        return f"{name} has the level {value['level']}"
    if name == "foxglove.PoseInFrame":
        norm = math.hypot(*value["pose"]["orientation"].values())
        # Before the device has told anything the whole pose is zero.
        if abs(norm - 1) > 1e-3 and value["hardware_tick"] > 0:
            return f"{name} has an orientation of length {norm}"
    if name == "foxglove.CompressedImage":
        begins = FORMATS.get(value["format"])
        if not begins or not base64.b64decode(value["data"], validate=True).startswith(begins):
            return f"{name} is no {value['format']}"
    return None


def curves(name, value, found):
    """PlotJuggler's curves of a message (plotjuggler_app/nlohmann_parsers.cpp): each number and truth by its path; texts have none."""
    if isinstance(value, dict):
        for key, inner in value.items():
            curves(f"{name}/{key}", inner, found)
    elif isinstance(value, list):
        for index, inner in enumerate(value):
            curves(f"{name}[{index}]", inner, found)
    elif isinstance(value, (bool, int, float)):
        found.add(name)


def main(path):
    complaints, found, newest = [], set(), {}

    def complain(words):
        if len(complaints) < MOST_TOLD:
            complaints.append(words)

    doctor = Doctor(complain)
    doctor.read(path)
    with open(path, "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        doctor.compare(summary.statistics)
        for channel in summary.channels.values():
            schema = summary.schemas[channel.schema_id]
            # Foxglove (parseChannel.ts) takes "json" with "jsonschema" or without a schema, PlotJuggler "json" with any.
            if (channel.message_encoding, schema.encoding) != ("json", "jsonschema"):
                complain(f"{channel.topic} is {channel.message_encoding} with {schema.encoding}")
            why = refused(json.loads(schema.data), channel.topic)
            if why:
                complain(f"Foxglove refuses {why}")
        for schema, channel, message in reader.iter_messages():
            value = json.loads(message.data)
            wrong = known(schema.name, value, message.log_time) if schema.name in KNOWN else None
            if wrong:
                complain(wrong)
            # A player draws by the time of the log, PlotJuggler by that of publishing unless it is told otherwise.
            if message.publish_time != message.log_time:
                complain(f"{channel.topic} was published at another time than it was logged")
            newest[channel.topic] = max(newest.get(channel.topic, 0), message.log_time)
            curves(channel.topic, value, found)
        places(file, summary, complain)
        groups(file, complain)
    print(json.dumps({"complaints": complaints, "curves": sorted(found), "newest_ns": newest}))


main(sys.argv[1])
