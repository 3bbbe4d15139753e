// Copyright 2026 Checkweigher maintainers
// SPDX-License-Identifier: Apache-2.0

//! A host of srad, for the protocol in `sparkplug_hosts.py`.

use std::collections::BTreeMap;

use serde_json::{json, Value};
use srad::app::{AppEvent, AppEventLoop, DeviceEvent, MetricDetails, NodeEvent, SubscriptionConfig};
use srad::client_rumqtt::{EventLoop, MqttOptions};
use srad::types::{MetricId, MetricValue};
use tokio::io::{stdin, AsyncBufReadExt, BufReader};

#[tokio::main]
async fn main() {
    let given: Vec<String> = std::env::args().skip(1).collect();
    let options = MqttOptions::new("srad", "127.0.0.1", given[0].parse().unwrap());
    let (events, client) = EventLoop::new(options, 0);
    let group = SubscriptionConfig::SingleGroup { group_id: given[1].clone() };
    let (mut application, client) = AppEventLoop::new("srad", group, events, client);
    // Each line on the input is the request of a rebirth.
    tokio::spawn(async move {
        let mut lines = BufReader::new(stdin()).lines();
        while let Ok(Some(_)) = lines.next_line().await {
            client.publish_node_rebirth(&given[1], &given[2]).await.unwrap();
        }
        std::process::exit(0);
    });
    loop {
        match application.poll().await {
            AppEvent::Online => println!("{}", json!({"kind": "connected"})),
            AppEvent::Node(node) => match node.event {
                NodeEvent::Birth(birth) => {
                    let own = BTreeMap::from([("bdSeq".to_string(), json!(birth.bdseq))]);
                    say("NBIRTH", own, birth.metrics_details.into_iter().map(|(of, its)| (of.name, its)));
                }
                NodeEvent::Death(death) => {
                    let own = BTreeMap::from([("bdSeq".to_string(), json!(death.bdseq))]);
                    say("NDEATH", own, std::iter::empty());
                }
                NodeEvent::Data(_) => {}
            },
            AppEvent::Device(device) => match device.event {
                DeviceEvent::Birth(birth) => {
                    let its = birth.metrics_details.into_iter().map(|(of, its)| (of.name, its));
                    say("DBIRTH", BTreeMap::new(), its);
                }
                DeviceEvent::Data(data) => {
                    let its = data.metrics_details.into_iter().map(|(of, its)| match of {
                        MetricId::Name(name) => (name, its),
                        MetricId::Alias(number) => (number.to_string(), its),
                    });
                    say("DDATA", BTreeMap::new(), its);
                }
                DeviceEvent::Death(_) => {}
            },
            AppEvent::InvalidPayload(error) => println!("{}", json!({"kind": "invalid", "error": format!("{error:?}")})),
            AppEvent::Offline | AppEvent::Cancelled => {}
        }
    }
}

fn say(
    kind: &str,
    mut metrics: BTreeMap<String, Value>,
    details: impl Iterator<Item = (String, MetricDetails)>,
) {
    let mut historical = Vec::new();
    for (name, its) in details {
        if its.is_historical {
            historical.push(name.clone());
        }
        metrics.insert(name, its.value.map_or(Value::Null, plain));
    }
    println!("{}", json!({"kind": kind, "metrics": metrics, "historical": historical}));
}

fn plain(value: MetricValue) -> Value {
    String::try_from(value.clone())
        .map(Value::from)
        .or_else(|_| bool::try_from(value.clone()).map(Value::from))
        .or_else(|_| f64::try_from(value.clone()).map(Value::from))
        .or_else(|_| i64::try_from(value).map(Value::from))
        .unwrap_or(Value::Null)
}
