// Copyright 2026 Checkweigher maintainers
// SPDX-License-Identifier: Apache-2.0

import ch.qos.logback.classic.Level;
import ch.qos.logback.classic.Logger;
import com.fasterxml.jackson.databind.ObjectMapper;
import java.io.FileInputStream;
import java.nio.file.Files;
import java.nio.file.Path;
import java.security.KeyFactory;
import java.security.KeyPair;
import java.security.PublicKey;
import java.security.cert.CertificateFactory;
import java.security.cert.X509Certificate;
import java.security.spec.PKCS8EncodedKeySpec;
import java.util.ArrayList;
import java.util.Arrays;
import java.util.Base64;
import java.util.List;
import java.util.Map;
import java.util.Optional;
import java.util.concurrent.BlockingQueue;
import java.util.concurrent.LinkedBlockingQueue;
import java.util.concurrent.TimeUnit;
import org.eclipse.milo.opcua.sdk.client.OpcUaClient;
import org.eclipse.milo.opcua.sdk.client.identity.UsernameProvider;
import org.eclipse.milo.opcua.sdk.client.subscriptions.OpcUaMonitoredItem;
import org.eclipse.milo.opcua.sdk.client.subscriptions.OpcUaSubscription;
import org.eclipse.milo.opcua.sdk.core.types.DynamicStructType;
import org.eclipse.milo.opcua.stack.core.AttributeId;
import org.eclipse.milo.opcua.stack.core.NodeIds;
import org.eclipse.milo.opcua.stack.core.StatusCodes;
import org.eclipse.milo.opcua.stack.core.UaException;
import org.eclipse.milo.opcua.stack.core.security.CertificateValidator;
import org.eclipse.milo.opcua.stack.core.security.SecurityPolicy;
import org.eclipse.milo.opcua.stack.core.types.builtin.ByteString;
import org.eclipse.milo.opcua.stack.core.types.builtin.DataValue;
import org.eclipse.milo.opcua.stack.core.types.builtin.DateTime;
import org.eclipse.milo.opcua.stack.core.types.builtin.ExtensionObject;
import org.eclipse.milo.opcua.stack.core.types.builtin.LocalizedText;
import org.eclipse.milo.opcua.stack.core.types.builtin.NodeId;
import org.eclipse.milo.opcua.stack.core.types.builtin.QualifiedName;
import org.eclipse.milo.opcua.stack.core.types.builtin.StatusCode;
import org.eclipse.milo.opcua.stack.core.types.builtin.Variant;
import org.eclipse.milo.opcua.stack.core.types.builtin.unsigned.Unsigned;
import org.eclipse.milo.opcua.stack.core.types.enumerated.BrowseDirection;
import org.eclipse.milo.opcua.stack.core.types.enumerated.MessageSecurityMode;
import org.eclipse.milo.opcua.stack.core.types.enumerated.TimestampsToReturn;
import org.eclipse.milo.opcua.stack.core.types.structured.BrowseDescription;
import org.eclipse.milo.opcua.stack.core.types.structured.CallMethodRequest;
import org.eclipse.milo.opcua.stack.core.types.structured.ContentFilter;
import org.eclipse.milo.opcua.stack.core.types.structured.ContentFilterElement;
import org.eclipse.milo.opcua.stack.core.types.structured.EventFilter;
import org.eclipse.milo.opcua.stack.core.types.structured.HistoryData;
import org.eclipse.milo.opcua.stack.core.types.structured.HistoryReadValueId;
import org.eclipse.milo.opcua.stack.core.types.structured.ReadRawModifiedDetails;
import org.eclipse.milo.opcua.stack.core.types.structured.ReadValueId;
import org.eclipse.milo.opcua.stack.core.types.structured.ReferenceDescription;
import org.eclipse.milo.opcua.stack.core.types.structured.SimpleAttributeOperand;
import org.eclipse.milo.opcua.stack.core.util.EndpointUtil;
import org.slf4j.LoggerFactory;

/** A client of Eclipse Milo, for the protocol in {@code foreign_plant.py}. */
public class OpcuaClient {
  private static final String SCALES = "http://opcfoundation.org/UA/Scales/V2/";
  private static final NodeId ACKNOWLEDGE = NodeId.parse("i=9111");
  private static final ObjectMapper JSON = new ObjectMapper();

  private final List<String> given;
  private final String lane;
  private OpcUaClient client;
  private BlockingQueue<DataValue> queue;
  private DateTime last;

  private OpcuaClient(String[] given) {
    this.given = List.of(given);
    this.lane = given[1];
  }

  public static void main(String[] given) throws Exception {
    ((Logger) LoggerFactory.getLogger(Logger.ROOT_LOGGER_NAME)).setLevel(Level.OFF);
    try {
      new OpcuaClient(given).run(Integer.parseInt(given[6]));
      System.exit(0);
    } catch (UaException error) {
      say(Map.of("refused", name(error.getStatusCode())));
      System.exit(1);
    }
  }

  private void run(int count) throws Exception {
    connect();
    List<String> nodes = new ArrayList<>();
    for (ReferenceDescription each : browse(id(""), NodeIds.HierarchicalReferences, true)) {
      nodes.add(each.getBrowseName().name());
    }
    say(Map.of("nodes", nodes, "needed", mandatory(scale(45))));
    String selected = select("heavy");
    say(Map.of("select", selected));
    if (count > 0) {
      if (selected.equals("Good")) {
        acknowledge();
        select("light");
        String execute = ".State.MachineState.ExecuteState";
        say(Map.of("unhold", call(id(execute), id(execute + ".Unhold"))));
      }
      receive(count);
      Object weight = client.readValue(0, TimestampsToReturn.Both, id(".RegisteredWeight")).value().value();
      var struct = (DynamicStructType) ((ExtensionObject) weight).decode(client.getDynamicEncodingContext());
      say(Map.of("gross", struct.getMembers().get("Gross")));
    }
    client.disconnect();
  }

  private void connect() throws Exception {
    X509Certificate certificate;
    try (var file = new FileInputStream(given.get(2))) {
      certificate = (X509Certificate) CertificateFactory.getInstance("X.509").generateCertificate(file);
    }
    String pem = Files.readString(Path.of(given.get(3))).replaceAll("-----[A-Z ]+-----|\\s", "");
    var key = KeyFactory.getInstance("RSA")
        .generatePrivate(new PKCS8EncodedKeySpec(Base64.getDecoder().decode(pem)));
    PublicKey open = certificate.getPublicKey();
    client = OpcUaClient.create(
        given.get(0),
        endpoints -> endpoints.stream()
            .filter(each -> each.getSecurityMode() == MessageSecurityMode.SignAndEncrypt
                && each.getSecurityPolicyUri().equals(SecurityPolicy.Basic256Sha256.getUri()))
            .findFirst()
            .map(each -> EndpointUtil.updateUrl(each, "127.0.0.1", EndpointUtil.getPort(given.get(0)))),
        transport -> {},
        config -> config
            .setApplicationUri("urn:plant:client")
            .setKeyPair(new KeyPair(open, key))
            .setCertificate(certificate)
            .setCertificateChain(new X509Certificate[] {certificate})
            .setCertificateValidator(new CertificateValidator.InsecureCertificateValidator())
            .setIdentityProvider(new UsernameProvider(given.get(4), given.get(5)))
            .setRequestTimeout(Unsigned.uint(10_000)));
    client.connect();
    var lane = new ReadValueId(id(""), AttributeId.BrowseName.uid(), null, QualifiedName.NULL_VALUE);
    StatusCode found = client.read(0, TimestampsToReturn.Both, List.of(lane)).getResults()[0].statusCode();
    if (!found.isGood()) { // the gateway has not found the lane yet
      client.disconnect();
      throw new UaException(found);
    }
  }

  private NodeId id(String path) {
    return new NodeId(client.getNamespaceTable().getIndex("urn:checkweigher"), lane + path);
  }

  private NodeId scale(int number) {
    return new NodeId(client.getNamespaceTable().getIndex(SCALES), Unsigned.uint(number));
  }

  private ReferenceDescription[] browse(NodeId node, NodeId kind, boolean forward) throws UaException {
    var direction = forward ? BrowseDirection.Forward : BrowseDirection.Inverse;
    var found = client.browse(
        new BrowseDescription(node, direction, kind, true, Unsigned.uint(0), Unsigned.uint(63)));
    return Optional.ofNullable(found.getReferences()).orElse(new ReferenceDescription[0]);
  }

  /** Return the names of the nodes that each instance of a type has. */
  private List<String> mandatory(NodeId type) throws UaException {
    List<String> names = new ArrayList<>();
    for (ReferenceDescription child : browse(type, NodeIds.HierarchicalReferences, true)) {
      NodeId node = child.getNodeId().toNodeId(client.getNamespaceTable()).orElseThrow();
      boolean needed = Arrays.stream(browse(node, NodeIds.HasModellingRule, true))
          .anyMatch(rule -> rule.getBrowseName().name().equals("Mandatory"));
      if (needed) {
        names.add(child.getBrowseName().name());
      }
    }
    for (ReferenceDescription parent : browse(type, NodeIds.HasSubtype, false)) {
      names.addAll(mandatory(parent.getNodeId().toNodeId(client.getNamespaceTable()).orElseThrow()));
    }
    return names;
  }

  private String call(NodeId object, NodeId method, Variant... values) throws UaException {
    var answer = client.call(List.of(new CallMethodRequest(object, method, values)));
    return name(answer.getResults()[0].getStatusCode());
  }

  private String select(String product) throws UaException {
    NodeId method = id(".ProductionPreset.SelectProduct");
    return call(id(".ProductionPreset"), method, Variant.ofString(product));
  }

  private SimpleAttributeOperand field(NodeId type, QualifiedName... path) {
    AttributeId attribute = path.length == 0 ? AttributeId.NodeId : AttributeId.Value;
    return new SimpleAttributeOperand(type, path, attribute.uid(), null);
  }

  /** Acknowledge the next active alarm, and wait until the server says that it is acknowledged. */
  private void acknowledge() throws Exception {
    var events = new LinkedBlockingQueue<Variant[]>();
    var subscription = new OpcUaSubscription(client, 100.0);
    subscription.create();
    SimpleAttributeOperand[] fields = {
      field(NodeIds.BaseEventType, new QualifiedName(0, "EventId")),
      field(NodeIds.ConditionType),
      field(scale(21), new QualifiedName(scale(21).getNamespaceIndex(), "VendorNotificationId")),
      field(NodeIds.AlarmConditionType, new QualifiedName(0, "ActiveState"), new QualifiedName(0, "Id")),
      field(NodeIds.AcknowledgeableConditionType, new QualifiedName(0, "AckedState"), new QualifiedName(0, "Id")),
    };
    var filter = new EventFilter(fields, new ContentFilter(new ContentFilterElement[0]));
    var item = OpcUaMonitoredItem.newEventItem(id(""), filter);
    item.setQueueSize(Unsigned.uint(100));
    item.setEventValueListener((its, values) -> events.add(values));
    subscription.addMonitoredItem(item);
    subscription.synchronizeMonitoredItems();
    call(NodeIds.ConditionType, NodeIds.ConditionType_ConditionRefresh,
        Variant.ofUInt32(subscription.getSubscriptionId().orElseThrow()));
    Variant[] event = next(events, false);
    String status = call((NodeId) event[1].value(), ACKNOWLEDGE,
        Variant.ofByteString((ByteString) event[0].value()),
        Variant.ofLocalizedText(LocalizedText.english("seen")));
    next(events, true);
    say(Map.of("alarm", event[2].value(), "acknowledged", status));
    subscription.delete();
  }

  private static Variant[] next(BlockingQueue<Variant[]> events, boolean acknowledged) throws Exception {
    while (true) {
      Variant[] event = events.take();
      if (Boolean.TRUE.equals(event[3].value()) && Boolean.valueOf(acknowledged).equals(event[4].value())) {
        return event;
      }
    }
  }

  /** Print the numbers of items, each once, also over a loss of the connection. */
  private void receive(int count) throws Exception {
    int came = 0;
    while (came < count) {
      try {
        came += received(count - came);
      } catch (UaException error) {
        client.disconnectAsync();
        reconnect();
      }
    }
  }

  private void reconnect() throws Exception {
    while (true) {
      try {
        connect();
        return;
      } catch (UaException error) {
        Thread.sleep(500);
      }
    }
  }

  private int received(int count) throws Exception {
    int came = 0;
    queue = new LinkedBlockingQueue<>();
    NodeId number = id(".RegisteredWeight.WeightId");
    var subscription = new OpcUaSubscription(client, 100.0);
    subscription.create();
    var item = OpcUaMonitoredItem.newDataItem(number);
    item.setQueueSize(Unsigned.uint(1000));
    BlockingQueue<DataValue> values = queue;
    item.setDataValueListener((its, value) -> values.add(value));
    subscription.addMonitoredItem(item);
    subscription.synchronizeMonitoredItems();
    if (last != null) {
      for (DataValue each : missed(number)) {
        came += show(each);
      }
    }
    while (came < count) {
      DataValue value = queue.poll(1, TimeUnit.SECONDS);
      if (value != null) {
        came += show(value);
      } else {
        client.readValue(0, TimestampsToReturn.Both, NodeIds.Server_ServerStatus_State);
      }
    }
    subscription.delete();
    return came;
  }

  private DataValue[] missed(NodeId node) throws UaException {
    var until = new DateTime(DateTime.now().getUtcTime() + 36_000_000_000L);
    var read = client.historyRead(
        new ReadRawModifiedDetails(false, last, until, Unsigned.uint(0), false),
        TimestampsToReturn.Both, false,
        List.of(new HistoryReadValueId(node, null, QualifiedName.NULL_VALUE, ByteString.NULL_VALUE)));
    ExtensionObject data = read.getResults()[0].getHistoryData();
    return ((HistoryData) data.decode(client.getStaticEncodingContext())).getDataValues();
  }

  private int show(DataValue value) throws Exception {
    DateTime time = value.sourceTime();
    if (value.value().isNull() || (last != null && time.getUtcTime() <= last.getUtcTime())) {
      return 0;
    }
    last = time;
    say(Map.of("item", value.value().value()));
    return 1;
  }

  private static String name(StatusCode code) {
    return StatusCodes.lookup(code.value()).map(found -> found[0].replace("_", "")).orElse("Good");
  }

  private static void say(Map<String, Object> words) throws Exception {
    System.out.println(JSON.writeValueAsString(words));
    System.out.flush();
  }
}
