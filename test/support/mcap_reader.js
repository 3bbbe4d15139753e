// Copyright 2026 Checkweigher maintainers
// SPDX-License-Identifier: Apache-2.0

// Foxglove's readers: prints the messages of an MCAP file as JSON, by the definitions in the file itself. NODE_PATH
// must have @mcap/core, @mcap/nodejs, @mcap/support, @foxglove/rosmsg and @foxglove/rosmsg2-serialization.
//   node mcap_reader.js FILE
const { open } = require('node:fs/promises');
const { McapIndexedReader } = require('@mcap/core');
const { FileHandleReadable } = require('@mcap/nodejs');
const { loadDecompressHandlers } = require('@mcap/support');
const { parse } = require('@foxglove/rosmsg');
const { MessageReader } = require('@foxglove/rosmsg2-serialization');

async function main(path) {
  const readable = new FileHandleReadable(await open(path, 'r'));
  const decompressHandlers = await loadDecompressHandlers();
  const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers });
  const readers = new Map();
  const found = {};
  for await (const message of reader.readMessages()) {
    const { topic, schemaId } = reader.channelsById.get(message.channelId);
    if (!readers.has(schemaId)) {
      const definition = new TextDecoder().decode(reader.schemasById.get(schemaId).data);
      readers.set(schemaId, new MessageReader(parse(definition, { ros2: true })));
    }
    (found[topic] ??= []).push(readers.get(schemaId).readMessage(message.data));
  }
  const plain = (key, value) => {
    if (ArrayBuffer.isView(value)) return Array.from(value);
    return typeof value === 'bigint' ? Number(value) : value;
  };
  console.log(JSON.stringify(found, plain));
}

main(process.argv[2]).catch((error) => {
  console.error(error);
  process.exit(1);
});
