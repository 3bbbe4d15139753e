// Copyright 2026 Checkweigher maintainers
// SPDX-License-Identifier: Apache-2.0

// A client of node-opcua-client, for the protocol in foreign_plant.py.
const { OPCUACertificateManager } = require('node-opcua-certificate-manager');
const opcua = require('node-opcua-client');

const SCALES = 'http://opcfoundation.org/UA/Scales/V2/';
const ACKNOWLEDGE = 'i=9111';
const [url, lane, certificateFile, privateKeyFile, userName, password, count] = process.argv.slice(2);

let client, session, own, scales, last;

const say = (words) => console.log(JSON.stringify(words));
const id = (path) => `ns=${own};s=${lane}${path}`;

async function connect() {
  client = opcua.OPCUAClient.create({
    applicationUri: 'urn:plant:client', certificateFile, privateKeyFile, endpointMustExist: false,
    securityMode: opcua.MessageSecurityMode.SignAndEncrypt, securityPolicy: opcua.SecurityPolicy.Basic256Sha256,
    clientCertificateManager: new OPCUACertificateManager({
      rootFolder: `${certificateFile}.pki`, automaticallyAcceptUnknownCertificate: true,
    }),
    connectionStrategy: { maxRetry: 0 },
  });
  await client.connect(url);
  session = await client.createSession({ type: opcua.UserTokenType.UserName, userName, password });
  const spaces = await session.readNamespaceArray();
  own = spaces.indexOf('urn:checkweigher');
  scales = spaces.indexOf(SCALES);
  const { statusCode } = await session.read({ nodeId: id(''), attributeId: opcua.AttributeIds.BrowseName });
  if (!statusCode.isGood()) { // the gateway has not found the lane yet
    await client.disconnect();
    throw new Error(statusCode.name);
  }
}

async function browse(nodeId, referenceTypeId, browseDirection) {
  const found = await session.browse({ nodeId, referenceTypeId, includeSubtypes: true, browseDirection, resultMask: 63 });
  return found.references;
}

// Returns the names of the nodes that each instance of a type has.
async function mandatory(type) {
  const names = [];
  for (const child of await browse(type, 'HierarchicalReferences', 0)) {
    const rules = await browse(child.nodeId, 'HasModellingRule', 0);
    if (rules.some((each) => each.browseName.name === 'Mandatory')) names.push(child.browseName.name);
  }
  for (const parent of await browse(type, 'HasSubtype', 1)) names.push(...await mandatory(parent.nodeId));
  return names;
}

async function call(objectId, methodId, inputArguments) {
  return (await session.call({ objectId, methodId, inputArguments })).statusCode.name;
}

const select = (product) => call(
  id('.ProductionPreset'), id('.ProductionPreset.SelectProduct'), [{ dataType: opcua.DataType.String, value: product }]);

// Acknowledges the next active alarm, and waits until the server says that it is acknowledged.
async function acknowledge() {
  const subscription = opcua.ClientSubscription.create(session, { requestedPublishingInterval: 100, publishingEnabled: true });
  const fields = ['EventId', 'ConditionId', `${scales}:VendorNotificationId`, 'ActiveState.Id', 'AckedState.Id'];
  const item = opcua.ClientMonitoredItem.create(
    subscription, { nodeId: id(''), attributeId: opcua.AttributeIds.EventNotifier },
    { queueSize: 100, filter: opcua.constructEventFilter(fields) });
  const next = (acknowledged) => new Promise((done) => {
    item.on('changed', function heard(event) {
      if (event[3].value !== true || event[4].value !== acknowledged) return;
      item.removeListener('changed', heard);
      done(event);
    });
  });
  const active = next(false);
  await new Promise((done) => item.once('initialized', done));
  const number = { dataType: opcua.DataType.UInt32, value: subscription.subscriptionId };
  await call('i=2782', 'i=3875', [number]); // ConditionRefresh, for an alarm from before the subscription
  const event = await active;
  const after = next(true);
  const acknowledged = await call(event[1].value, ACKNOWLEDGE, [
    { dataType: opcua.DataType.ByteString, value: event[0].value },
    { dataType: opcua.DataType.LocalizedText, value: opcua.coerceLocalizedText('seen') },
  ]);
  await after;
  say({ alarm: event[2].value, acknowledged });
  await subscription.terminate();
}

function show(value) {
  const time = value.sourceTimestamp;
  if (left === 0 || value.value.value === null || (last && time <= last)) return;
  last = time;
  left -= 1;
  say({ item: value.value.value });
}

let left = Number(count);

// Prints the numbers of items, each once, also over a loss of the connection.
async function receive() {
  const nodeId = id('.RegisteredWeight.WeightId');
  const subscription = opcua.ClientSubscription.create(session, { requestedPublishingInterval: 100, publishingEnabled: true });
  const item = opcua.ClientMonitoredItem.create(
    subscription, { nodeId, attributeId: opcua.AttributeIds.Value }, { samplingInterval: 0, queueSize: 1000 });
  let early = [];
  item.on('changed', (value) => (early ? early.push(value) : show(value)));
  if (last) {
    const missed = await session.readHistoryValue(nodeId, last, new Date(Date.now() + 3600e3));
    missed.historyData.dataValues.forEach(show);
  }
  while (left > 0) {
    if (early && item.monitoredItemId) {
      early.forEach(show);
      early = null;
    }
    await new Promise((done) => setTimeout(done, 200));
    const state = await session.read({ nodeId: 'i=2259', attributeId: opcua.AttributeIds.Value });
    if (!state.statusCode.isGood()) throw new Error(state.statusCode.name);
  }
}

async function reconnect() {
  for (;;) {
    try {
      return await connect();
    } catch {
      await new Promise((done) => setTimeout(done, 500));
    }
  }
}

async function main() {
  await connect();
  const nodes = (await browse(id(''), 'HierarchicalReferences', 0)).map((each) => each.browseName.name);
  say({ nodes, needed: await mandatory(`ns=${scales};i=45`) });
  const selected = await select('heavy');
  say({ select: selected });
  if (!left) return;
  if (selected === 'Good') {
    await acknowledge();
    await select('light');
    const execute = '.State.MachineState.ExecuteState';
    say({ unhold: await call(id(execute), id(`${execute}.Unhold`), []) });
  }
  while (left > 0) {
    await receive().catch(async () => {
      client.disconnect().catch(() => {});
      await reconnect();
    });
  }
  const weight = await session.read({ nodeId: id('.RegisteredWeight'), attributeId: opcua.AttributeIds.Value });
  say({ gross: weight.value.value.gross });
}

main().then(() => process.exit(0), (error) => { say({ refused: error.message }); process.exit(1); });
