"""Says as JSON what a recording holds, read by the `mcap` package of PyPI and nothing of ours: of each topic its encoding, its schema and its messages, of
which each is checked against the schema; the bits of each tick's force and pose, of the controls, of what tissue and fluid say of themselves, and the steps'
hashes. For tests/reader.rs."""

import json
import struct
import sys

from mcap.reader import make_reader

TYPES = {"object": dict, "array": list, "string": str, "integer": int, "number": (int, float)}


def misfit(schema, value, where):
    """What of a value is not as its schema says; the first of it, in words."""
    kind = schema.get("type")
    if isinstance(value, bool) or not isinstance(value, TYPES[kind]):
        return f"{where}: {value!r} is no {kind}"
    if kind == "object":
        known = schema.get("properties", {})
        for name in value:
            if name not in known:
                return f"{where}: {name} is not in the schema"
        for name in known.keys() & value.keys():  # none is required: a number that is not finite is left out
            found = misfit(known[name], value[name], f"{where}.{name}")
            if found:
                return found
    if kind == "array":
        for item in value:
            found = misfit(schema["items"], item, f"{where}[]")
            if found:
                return found
    return None


def bits(vector, names="xyz"):
    return [struct.unpack("<I", struct.pack("<f", vector[name]))[0] for name in names]


def wide(message, names):
    return [struct.unpack("<Q", struct.pack("<d", message[name]))[0] for name in names]


CONTROLS = ("inflow_valve", "outflow_valve", "set_pressure_pa", "light", "loop_extension_m", "focus_m")
MEDIUM = ("pressure_pa", "inflow_ml_min", "outflow_ml_min")


def main(path):
    topics, forces, places, steps, controls, fluid, tissue = {}, [], [], [], [], [], []
    with open(path, "rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        counted = {summary.channels[id].topic: count for id, count in summary.statistics.channel_message_counts.items()}
        for schema, channel, message in reader.iter_messages():
            of_topic = topics.setdefault(channel.topic, {
                "messages": 0, "encoding": channel.message_encoding, "schema": schema.name, "schema_encoding": schema.encoding,
                "misfit": None, "parsed": json.loads(schema.data),
            })
            value = json.loads(message.data)
            of_topic["messages"] += 1
            of_topic["misfit"] = of_topic["misfit"] or misfit(of_topic["parsed"], value, channel.topic)
            if channel.topic == "/force":
                forces.append([value["tick"], *bits(value["force_n"])])
            if channel.topic == "/tool":
                pose = value["pose"]
                places.append([value["tick"], *bits(pose["position"]), *bits(pose["orientation"], "xyzw")])
            if channel.topic == "/controls":
                controls.append([value["tick"], value["buttons"], *bits(value, CONTROLS)])
            if channel.topic == "/fluid":
                exact = wide(value, ("deficit_ml", "cavity_volume_ml", "bled_ml"))
                fluid.append([value["tick"], *exact, *bits(value, MEDIUM), value["alarms"]])
            if channel.topic == "/tissue":
                tissue.append([value["tick"], *wide(value, ("removed_volume_ml",)), value["contact_count"]])
            if channel.topic == "/steps":
                steps.append([value["tick"], value["state_hash"]])
    for of_topic in topics.values():
        del of_topic["parsed"]
    print(json.dumps({
        "counted": counted, "topics": topics, "forces": forces, "places": places, "steps": steps, "controls": controls,
        "fluid": fluid, "tissue": tissue,
    }))


main(sys.argv[1])
