// Reads the OPC UA door of `lmctl dash` by a second, independent stack.
//
//     npm install node-opcua-client && node browse_opcua.js opc.tcp://127.0.0.1:4840/lmctl
//
// Prints one JSON object: how many objects and variables it found below Machines, how many of these
// have a good value, the ones that OPC 40540 names, and whether writing was refused.

"use strict";
const { AttributeIds, DataType, MessageSecurityMode, NodeClass, OPCUAClient, SecurityPolicy } =
  require("node-opcua-client");

const NAMED = ["Identification", "Equipment", "Feedstock", "Monitoring", "Process", "Health",
  "JobManagement", "RunInformation", "Notification", "Messages"];

async function main(url) {
  const client = OPCUAClient.create({ endpointMustExist: false, securityMode: MessageSecurityMode.None,
    securityPolicy: SecurityPolicy.None, connectionStrategy: { maxRetry: 1 } });
  await client.connect(url);
  const session = await client.createSession();
  const found = { objects: 0, variables: 0, good: 0, named: [], write_refused: false };
  const namespaces = await session.readNamespaceArray();
  const machines = `ns=${namespaces.indexOf("urn:lmctl:live")};s=Machines`;
  const todo = [machines], names = new Set();
  let variable = null;
  while (todo.length) {
    const answer = await session.browse(todo.pop());
    for (const one of answer.references ?? []) {
      if (!one.isForward || one.nodeId.namespace === 0) continue;
      names.add(one.browseName.name);
      todo.push(one.nodeId.toString());
      if (one.nodeClass === NodeClass.Object) { found.objects++; continue; }
      found.variables++;
      const value = await session.read({ nodeId: one.nodeId, attributeId: AttributeIds.Value });
      if (value.statusCode.isGood()) { found.good++; variable = one.nodeId; }
    }
  }
  found.named = NAMED.filter((name) => names.has(name));
  const status = await session.write({ nodeId: variable, attributeId: AttributeIds.Value,
    value: { value: { dataType: DataType.Double, value: 1 } } });
  found.write_refused = !status.isGood();
  await session.close();
  await client.disconnect();
  console.log(JSON.stringify(found));
  process.exit(found.write_refused && found.named.length === NAMED.length ? 0 : 1);
}

main(process.argv[2]).catch((error) => { console.error(error.message); process.exit(2); });
