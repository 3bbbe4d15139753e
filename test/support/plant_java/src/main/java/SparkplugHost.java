// Copyright 2026 Checkweigher maintainers
// SPDX-License-Identifier: Apache-2.0

import ch.qos.logback.classic.Level;
import ch.qos.logback.classic.Logger;
import com.fasterxml.jackson.databind.ObjectMapper;
import java.util.ArrayList;
import java.util.Date;
import java.util.HashMap;
import java.util.List;
import java.util.Map;
import java.util.Scanner;
import org.eclipse.tahu.host.HostApplication;
import org.eclipse.tahu.host.api.HostApplicationEventHandler;
import org.eclipse.tahu.message.SparkplugBPayloadDecoder;
import org.eclipse.tahu.message.model.DeviceDescriptor;
import org.eclipse.tahu.message.model.EdgeNodeDescriptor;
import org.eclipse.tahu.message.model.Message;
import org.eclipse.tahu.message.model.Metric;
import org.eclipse.tahu.message.model.Metric.MetricBuilder;
import org.eclipse.tahu.message.model.MetricDataType;
import org.eclipse.tahu.message.model.MessageType;
import org.eclipse.tahu.message.model.SparkplugBPayload.SparkplugBPayloadBuilder;
import org.eclipse.tahu.message.model.SparkplugDescriptor;
import org.eclipse.tahu.message.model.Topic;
import org.eclipse.tahu.model.MqttServerDefinition;
import org.eclipse.tahu.mqtt.MqttClientId;
import org.eclipse.tahu.mqtt.MqttServerName;
import org.eclipse.tahu.mqtt.MqttServerUrl;
import org.slf4j.LoggerFactory;

/** A host of Eclipse Tahu, for the protocol in {@code foreign_plant.py}. */
public class SparkplugHost implements HostApplicationEventHandler {
  private static final ObjectMapper JSON = new ObjectMapper();

  public static void main(String[] given) throws Exception {
    ((Logger) LoggerFactory.getLogger(Logger.ROOT_LOGGER_NAME)).setLevel(Level.OFF);
    var server = new MqttServerDefinition(
        new MqttServerName("plant"), new MqttClientId("tahu", false),
        new MqttServerUrl("tcp://127.0.0.1:" + given[0]), null, null, 10, null);
    var host = new HostApplication(
        new SparkplugHost(), "tahu", List.of("spBv1.0/" + given[1] + "/#"), List.of(server), null,
        new SparkplugBPayloadDecoder(), true);
    host.start(true);
    // Each line on the input is the request of a rebirth.
    var input = new Scanner(System.in);
    while (input.hasNextLine()) {
      input.nextLine();
      Metric rebirth = new MetricBuilder("Node Control/Rebirth", MetricDataType.Boolean, true).createMetric();
      var payload = new SparkplugBPayloadBuilder().setTimestamp(new Date()).addMetric(rebirth).createPayload();
      host.publishCommand(new Topic("spBv1.0", given[1], given[2], MessageType.NCMD), payload);
    }
    host.shutdown();
    System.exit(0);
  }

  private static void say(String kind, Message message) {
    Map<String, Object> metrics = new HashMap<>();
    List<String> old = new ArrayList<>();
    if (message.getPayload() != null) {
      for (Metric each : message.getPayload().getMetrics()) {
        metrics.put(each.getName(), each.getValue());
        if (Boolean.TRUE.equals(each.isHistorical())) {
          old.add(each.getName());
        }
      }
    }
    print(Map.of("kind", kind, "metrics", metrics, "historical", old));
  }

  private static synchronized void print(Map<String, Object> words) {
    try {
      System.out.println(JSON.writeValueAsString(words));
    } catch (Exception error) {
      throw new IllegalStateException(error);
    }
  }

  @Override
  public void onConnect() {
    print(Map.of("kind", "connected"));
  }

  @Override
  public void onNodeBirthArrived(EdgeNodeDescriptor node, Message message) {
    say("NBIRTH", message);
  }

  @Override
  public void onNodeDeath(EdgeNodeDescriptor node, Message message) {
    say("NDEATH", message);
  }

  @Override
  public void onDeviceBirthArrived(DeviceDescriptor device, Message message) {
    say("DBIRTH", message);
  }

  @Override
  public void onDeviceDataArrived(DeviceDescriptor device, Message message) {
    say("DDATA", message);
  }

  @Override
  public void onDisconnect() {}

  @Override
  public void onMessage(SparkplugDescriptor descriptor, Message message) {}

  @Override
  public void onNodeBirthComplete(EdgeNodeDescriptor node) {}

  @Override
  public void onNodeDataArrived(EdgeNodeDescriptor node, Message message) {}

  @Override
  public void onNodeDataComplete(EdgeNodeDescriptor node) {}

  @Override
  public void onNodeDeathComplete(EdgeNodeDescriptor node) {}

  @Override
  public void onDeviceBirthComplete(DeviceDescriptor device) {}

  @Override
  public void onDeviceDataComplete(DeviceDescriptor device) {}

  @Override
  public void onDeviceDeath(DeviceDescriptor device, Message message) {}

  @Override
  public void onDeviceDeathComplete(DeviceDescriptor device) {}

  @Override
  public void onBirthMetric(SparkplugDescriptor descriptor, Metric metric) {}

  @Override
  public void onDataMetric(SparkplugDescriptor descriptor, Metric metric) {}

  @Override
  public void onStale(SparkplugDescriptor descriptor, Metric metric) {}
}
