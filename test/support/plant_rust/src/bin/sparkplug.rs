// Copyright 2026 Checkweigher maintainers
// SPDX-License-Identifier: Apache-2.0

//! A host of srad, for the protocol in `foreign_plant.py`.

use std::collections::BTreeMap;

use serde_json::{json, Value};
use srad::app::generic_app::{ApplicationBuilder, MetricStore, StateUpdateError};
use srad::app::{MetricBirthDetails, MetricDetails, SubscriptionConfig};
use srad::client_rumqtt::{EventLoop, MqttOptions};
use srad::types::{MetricId, MetricValue};
use tokio::io::{stdin, AsyncBufReadExt, BufReader};

/// Prints the messages of a node, or of a device.
struct Printer(&'static str);

impl MetricStore for Printer {
    fn set_stale(&mut self) {
        say(self.0, "DEATH", std::iter::empty());
    }

    fn update_from_birth(
        &mut self,
        details: Vec<(MetricBirthDetails, MetricDetails)>,
    ) -> Result<(), StateUpdateError> {
        say(self.0, "BIRTH", details.into_iter().map(|(of, its)| (of.name, its)));
        Ok(())
    }

    fn update_from_data(
        &mut self,
        details: Vec<(MetricId, MetricDetails)>,
    ) -> Result<(), StateUpdateError> {
        let its = details.into_iter().map(|(of, its)| match of {
            MetricId::Name(name) => (name, its),
            MetricId::Alias(number) => (number.to_string(), its),
        });
        say(self.0, "DATA", its);
        Ok(())
    }
}

#[tokio::main]
async fn main() {
    let given: Vec<String> = std::env::args().skip(1).collect();
    let options = MqttOptions::new("srad", "127.0.0.1", given[0].parse().unwrap());
    let (events, client) = EventLoop::new(options, 0);
    let group = SubscriptionConfig::SingleGroup { group_id: given[1].clone() };
    let (application, client) = ApplicationBuilder::new("srad", events, client, group)
        .on_online(|| println!("{}", json!({"kind": "connected"})))
        .on_node_created(|node| {
            node.register_metric_store(Printer("N"));
            node.on_device_created(|device| device.register_metric_store(Printer("D")));
        })
        .build();
    // Each line on the input is the request of a rebirth.
    tokio::spawn(async move {
        let mut lines = BufReader::new(stdin()).lines();
        while let Ok(Some(_)) = lines.next_line().await {
            client.publish_node_rebirth(&given[1], &given[2]).await.unwrap();
        }
        std::process::exit(0);
    });
    application.run().await
}

fn say(of: &str, what: &str, details: impl Iterator<Item = (String, MetricDetails)>) {
    let (mut metrics, mut historical) = (BTreeMap::new(), Vec::new());
    for (name, its) in details {
        if its.is_historical {
            historical.push(name.clone());
        }
        metrics.insert(name, its.value.map_or(Value::Null, plain));
    }
    println!("{}", json!({"kind": format!("{of}{what}"), "metrics": metrics, "historical": historical}));
}

fn plain(value: MetricValue) -> Value {
    String::try_from(value.clone())
        .map(Value::from)
        .or_else(|_| bool::try_from(value.clone()).map(Value::from))
        .or_else(|_| f64::try_from(value.clone()).map(Value::from))
        .or_else(|_| i64::try_from(value).map(Value::from))
        .unwrap_or(Value::Null)
}
