// Copyright 2026 Checkweigher maintainers
// SPDX-License-Identifier: Apache-2.0

// A client of OPC UA that does not share a line of code with the server: node-opcua-client, which must be in NODE_PATH.
//   node opcua_client.js URL LANE COUNT USER PASSWORD
// prints as JSON what it has browsed, COUNT items with their masses, and the status of two calls of SelectProduct.
const opcua = require('node-opcua-client');

async function main(url, lane, count, userName, password) {
  const client = opcua.OPCUAClient.create({ endpointMustExist: false });
  await client.connect(url);
  const session = await client.createSession();
  const spaces = await session.readNamespaceArray();
  const own = spaces.indexOf('urn:checkweigher');
  const scales = spaces.indexOf('http://opcfoundation.org/UA/Scales/V2/');
  const id = (path) => `ns=${own};s=${lane}${path}`;

  async function browse(nodeId) {
    const found = await session.browse({
      nodeId, referenceTypeId: 'HierarchicalReferences', includeSubtypes: true, browseDirection: 0, resultMask: 63,
    });
    return found.references.map((each) => [each.browseName.name, each.nodeId]);
  }
  async function mandatory(type) {
    const names = [];
    for (const [name, nodeId] of await browse(type)) {
      const rules = await session.browse({ nodeId, referenceTypeId: 'HasModellingRule', browseDirection: 0, resultMask: 63 });
      if (rules.references.some((each) => each.browseName.name === 'Mandatory')) names.push(name);
    }
    const above = await session.browse({ nodeId: type, referenceTypeId: 'HasSubtype', browseDirection: 1, resultMask: 63 });
    return above.references.length ? names.concat(await mandatory(above.references[0].nodeId)) : names;
  }
  const nodes = (await browse(id(''))).map(([name]) => name);
  const needed = await mandatory(`ns=${scales};i=45`);

  const subscription = opcua.ClientSubscription.create(session, { requestedPublishingInterval: 100, publishingEnabled: true });
  const item = opcua.ClientMonitoredItem.create(
    subscription, { nodeId: id('.RegisteredWeight.WeightId'), attributeId: opcua.AttributeIds.Value },
    { samplingInterval: 0, queueSize: 1000, discardOldest: false });
  const items = [];
  await new Promise((done) => item.on('changed', (data) => { if (items.push(data.value.value) >= count) done(); }));
  const weight = await session.read({ nodeId: id('.RegisteredWeight'), attributeId: opcua.AttributeIds.Value });

  const call = (its) => its.call({
    objectId: id('.ProductionPreset'), methodId: id('.ProductionPreset.SelectProduct'),
    inputArguments: [{ dataType: opcua.DataType.String, value: 'light' }],
  });
  const anonymous = (await call(session)).statusCode.name;
  await session.close();
  const named = await client.createSession({ type: opcua.UserTokenType.UserName, userName, password });
  const operator = (await call(named)).statusCode.name;
  await named.close();
  await client.disconnect();
  console.log(JSON.stringify({ nodes, needed, items, gross: weight.value.value.gross, anonymous, operator }));
}

const [url, lane, count, user, password] = process.argv.slice(2);
main(url, lane, Number(count), user, password).then(() => process.exit(0), (error) => { console.error(error); process.exit(1); });
