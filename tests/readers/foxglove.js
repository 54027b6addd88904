// Says as JSON what Foxglove's own reader finds in a recording: by its index, messages of each topic and the names of the metadata; and of its first nine
// tenths, as a station that lost its power leaves it, the messages of each topic that a reader without an index comes to. For tests/reader.rs; by hand:
// npm install --prefix target/reader @mcap/core @mcap/support
// NODE_PATH=target/reader/node_modules node tests/readers/foxglove.js FILE
"use strict";
const fs = require("fs");
const { McapIndexedReader, McapStreamReader } = require("@mcap/core");
const { loadDecompressHandlers } = require("@mcap/support");

/** The file as that reader wants it: parts of it by their place. */
function readable(path) {
    const file = fs.openSync(path);
    const size = BigInt(fs.fstatSync(file).size);
    const read = async (at, length) => {
        const bytes = Buffer.alloc(Number(length));
        const count = fs.readSync(file, bytes, 0, bytes.length, Number(at));
        if (count !== bytes.length) throw new Error(`${count} of ${length} bytes at ${at}`);
        return new Uint8Array(bytes);
    };
    return { size: async () => size, read };
}

const add = (counts, topic) => { counts[topic] = (counts[topic] ?? 0) + 1; };

async function byIndex(path, decompressHandlers) {
    const reader = await McapIndexedReader.Initialize({ readable: readable(path), decompressHandlers });
    const [messages, metadata] = [{}, []];
    let newest = 0n;
    for await (const message of reader.readMessages()) {
        if (message.logTime < newest) throw new Error(`a message of ${message.logTime} comes after one of ${newest}`);
        newest = message.logTime;
        JSON.parse(new TextDecoder().decode(message.data));
        add(messages, reader.channelsById.get(message.channelId).topic);
    }
    for await (const record of reader.readMetadata()) metadata.push(record.name);
    return { messages, metadata };
}

function withoutIndex(path, decompressHandlers) {
    const bytes = fs.readFileSync(path);
    const reader = new McapStreamReader({ decompressHandlers });
    reader.append(bytes.subarray(0, Math.floor(bytes.length * 0.9)));
    const [topics, messages] = [new Map(), {}];
    for (let record; (record = reader.nextRecord()); ) {
        if (record.type === "Channel") topics.set(record.id, record.topic);
        if (record.type === "Message") add(messages, topics.get(record.channelId));
    }
    return { messages };
}

async function main(path) {
    const decompressHandlers = await loadDecompressHandlers();
    const found = { whole: await byIndex(path, decompressHandlers), cut: withoutIndex(path, decompressHandlers) };
    console.log(JSON.stringify(found));
}

main(process.argv[2]).catch((error) => {
    console.error(error);
    process.exit(1);
});
