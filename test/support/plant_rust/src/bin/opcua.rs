// Copyright 2026 Checkweigher maintainers
// SPDX-License-Identifier: Apache-2.0

//! A client of async-opcua, for the protocol in `foreign_plant.py`.

use std::error::Error as StdError;
use std::sync::Arc;
use std::time::Duration;

use opcua::client::custom_types::DataTypeTreeBuilder;
use opcua::client::{
    ClientBuilder, DataChangeCallback, EventCallback, HistoryReadAction, IdentityToken, Session,
};
use opcua::types::custom::{DynamicStructure, DynamicTypeLoader};
use opcua::types::*;
use serde_json::json;
use tokio::sync::mpsc::{unbounded_channel, UnboundedReceiver};
use tokio::time::timeout;

const SCALES: &str = "http://opcfoundation.org/UA/Scales/V2/";
const ACKNOWLEDGE: u32 = 9111;

type Outcome<T> = Result<T, Box<dyn StdError>>;

struct Lane {
    given: Vec<String>,
    session: Arc<Session>,
    own: u16,
    scales: u16,
    last: Option<DateTime>,
}

#[tokio::main]
async fn main() {
    let given: Vec<String> = std::env::args().skip(1).collect();
    if let Err(error) = run(given).await {
        println!("{}", json!({"refused": error.to_string()}));
        std::process::exit(1);
    }
    std::process::exit(0);
}

async fn run(given: Vec<String>) -> Outcome<()> {
    let count: usize = given[6].parse()?;
    let mut lane = connect(given).await?;
    let nodes = lane.names(&lane.id("")).await?;
    let needed = lane.mandatory(NodeId::new(lane.scales, 45u32)).await?;
    println!("{}", json!({"nodes": nodes, "needed": needed}));
    let selected = lane.select("heavy").await?;
    println!("{}", json!({"select": selected}));
    if count > 0 {
        if selected == "Good" {
            lane.acknowledge().await?;
            lane.select("light").await?;
            let execute = ".State.MachineState.ExecuteState";
            let unhold = lane.id(&format!("{execute}.Unhold"));
            println!("{}", json!({"unhold": lane.call(lane.id(execute), unhold, vec![]).await?}));
        }
        lane.receive(count).await?;
        println!("{}", json!({"gross": lane.gross().await?}));
    }
    Ok(())
}

async fn connect(given: Vec<String>) -> Outcome<Lane> {
    let mut client = ClientBuilder::new()
        .application_name("plant")
        .application_uri("urn:plant:client")
        .pki_dir(format!("{}.pki", given[2]))
        .certificate_path(given[2].clone())
        .private_key_path(given[3].clone())
        .trust_server_certs(true)
        .verify_server_certs(false)
        .session_retry_limit(0)
        .request_timeout(Duration::from_secs(10))
        .client()
        .map_err(|errors| errors.join(", "))?;
    let endpoint: EndpointDescription = (
        given[0].as_str(),
        "http://opcfoundation.org/UA/SecurityPolicy#Basic256Sha256",
        MessageSecurityMode::SignAndEncrypt,
    )
        .into();
    let user = IdentityToken::new_user_name(given[4].clone(), given[5].clone());
    let (session, events) = client.connect_to_matching_endpoint(endpoint, user).await?;
    let mut ended = events.spawn();
    tokio::select! {
        status = &mut ended => return Err(status?.to_string().into()),
        _ = session.wait_for_connection() => {}
    }
    let own = session.get_namespace_index("urn:checkweigher").await?;
    let scales = session.get_namespace_index(SCALES).await?;
    let lane = Lane { given, session, own, scales, last: None };
    let wanted = ReadValueId::new(lane.id(""), AttributeId::BrowseName);
    let found = lane.session.read(&[wanted], TimestampsToReturn::Both, 0.0).await?[0].status();
    if !found.is_good() {
        // The gateway has not found the lane yet.
        lane.session.disconnect().await?;
        return Err(found.to_string().into());
    }
    Ok(lane)
}

impl Lane {
    fn id(&self, path: &str) -> NodeId {
        NodeId::new(self.own, format!("{}{path}", self.given[1]))
    }

    async fn browse(
        &self,
        node: &NodeId,
        kind: ReferenceTypeId,
        direction: BrowseDirection,
    ) -> Outcome<Vec<ReferenceDescription>> {
        let wanted = BrowseDescription {
            node_id: node.clone(),
            browse_direction: direction,
            reference_type_id: kind.into(),
            include_subtypes: true,
            node_class_mask: 0,
            result_mask: 63,
        };
        let mut found = self.session.browse(&[wanted], 0, None).await?;
        Ok(found.remove(0).references.unwrap_or_default())
    }

    async fn names(&self, node: &NodeId) -> Outcome<Vec<String>> {
        let kind = ReferenceTypeId::HierarchicalReferences;
        let found = self.browse(node, kind, BrowseDirection::Forward).await?;
        Ok(found.iter().map(|each| each.browse_name.name.to_string()).collect())
    }

    /// Return the names of the nodes that each instance of a type has.
    async fn mandatory(&self, first: NodeId) -> Outcome<Vec<String>> {
        let (mut names, mut types) = (Vec::new(), vec![first]);
        while let Some(kind) = types.pop() {
            let below = ReferenceTypeId::HierarchicalReferences;
            for child in self.browse(&kind, below, BrowseDirection::Forward).await? {
                let node = &child.node_id.node_id;
                let rule = ReferenceTypeId::HasModellingRule;
                let rules = self.browse(node, rule, BrowseDirection::Forward).await?;
                if rules.iter().any(|each| each.browse_name.name.as_ref() == "Mandatory") {
                    names.push(child.browse_name.name.to_string());
                }
            }
            let above = ReferenceTypeId::HasSubtype;
            for parent in self.browse(&kind, above, BrowseDirection::Inverse).await? {
                types.push(parent.node_id.node_id);
            }
        }
        Ok(names)
    }

    async fn call(&self, object: NodeId, method: NodeId, values: Vec<Variant>) -> Outcome<String> {
        let answer = self.session.call_one((object, method, Some(values))).await?;
        Ok(answer.status_code.to_string())
    }

    async fn select(&self, product: &str) -> Outcome<String> {
        let preset = self.id(".ProductionPreset");
        let method = self.id(".ProductionPreset.SelectProduct");
        self.call(preset, method, vec![Variant::from(product)]).await
    }

    /// Acknowledge the next active alarm, and wait until the server says that it is acknowledged.
    async fn acknowledge(&self) -> Outcome<()> {
        let field = |kind: NodeId, path: &[(u16, &str)]| SimpleAttributeOperand {
            type_definition_id: kind,
            browse_path: Some(path.iter().map(|(space, name)| QualifiedName::new(*space, *name)).collect()),
            attribute_id: if path.is_empty() { AttributeId::NodeId } else { AttributeId::Value } as u32,
            index_range: NumericRange::None,
        };
        let acknowledgeable = ObjectTypeId::AcknowledgeableConditionType;
        let filter = EventFilter {
            select_clauses: Some(vec![
                field(ObjectTypeId::BaseEventType.into(), &[(0, "EventId")]),
                field(ObjectTypeId::ConditionType.into(), &[]),
                field(NodeId::new(self.scales, 21u32), &[(self.scales, "VendorNotificationId")]),
                field(ObjectTypeId::AlarmConditionType.into(), &[(0, "ActiveState"), (0, "Id")]),
                field(acknowledgeable.into(), &[(0, "AckedState"), (0, "Id")]),
            ]),
            where_clause: ContentFilter::default(),
        };
        let (send, mut events) = unbounded_channel();
        let callback = EventCallback::new(move |fields, _| {
            let _ = send.send(fields.unwrap_or_default());
        });
        let period = Duration::from_millis(100);
        let number = self.session.create_subscription(period, 1000, 10, 0, 0, true, callback).await?;
        let mut item = MonitoredItemCreateRequest::from(self.id(""));
        item.item_to_monitor.attribute_id = AttributeId::EventNotifier as u32;
        item.requested_parameters.filter = ExtensionObject::from_message(filter);
        item.requested_parameters.queue_size = 100;
        self.session.create_monitored_items(number, TimestampsToReturn::Both, vec![item]).await?;
        let refresh = MethodId::ConditionType_ConditionRefresh.into();
        let kind = ObjectTypeId::ConditionType.into();
        self.call(kind, refresh, vec![Variant::from(number)]).await?;
        let event = next(&mut events, false).await?;
        let Variant::NodeId(condition) = event[1].clone() else {
            return Err("the event has no condition".into());
        };
        let comment = Variant::from(LocalizedText::new("en", "seen"));
        let values = vec![event[0].clone(), comment];
        let status = self.call(*condition, NodeId::new(0, ACKNOWLEDGE), values).await?;
        next(&mut events, true).await?;
        println!("{}", json!({"alarm": event[2].to_string(), "acknowledged": status}));
        self.session.delete_subscription(number).await?;
        Ok(())
    }

    /// Print the numbers of items, each once, also over a loss of the connection.
    async fn receive(&mut self, count: usize) -> Outcome<()> {
        let mut left = count;
        while let Err(error) = self.received(&mut left).await {
            eprintln!("{error}");
            loop {
                tokio::time::sleep(Duration::from_millis(500)).await;
                if let Ok(lane) = connect(self.given.clone()).await {
                    *self = Lane { last: self.last, ..lane };
                    break;
                }
            }
        }
        Ok(())
    }

    async fn received(&mut self, left: &mut usize) -> Outcome<()> {
        let node = self.id(".RegisteredWeight.WeightId");
        let (send, mut values) = unbounded_channel();
        let callback = DataChangeCallback::new(move |value, _| {
            let _ = send.send(value);
        });
        let period = Duration::from_millis(100);
        let number = self.session.create_subscription(period, 1000, 10, 0, 0, true, callback).await?;
        let mut item = MonitoredItemCreateRequest::from(node.clone());
        item.requested_parameters.queue_size = 1000;
        self.session.create_monitored_items(number, TimestampsToReturn::Both, vec![item]).await?;
        if let Some(last) = self.last {
            for value in self.missed(node, last).await? {
                self.show(value, left);
            }
        }
        while *left > 0 {
            match timeout(Duration::from_secs(1), values.recv()).await {
                Ok(Some(value)) => self.show(value, left),
                _ => {
                    let state = VariableId::Server_ServerStatus_State;
                    let wanted = ReadValueId::new_value(state.into());
                    self.session.read(&[wanted], TimestampsToReturn::Both, 0.0).await?;
                }
            }
        }
        self.session.delete_subscription(number).await?;
        Ok(())
    }

    async fn missed(&self, node: NodeId, last: DateTime) -> Outcome<Vec<DataValue>> {
        let wanted = HistoryReadAction::ReadRawModifiedDetails(ReadRawModifiedDetails {
            is_read_modified: false,
            start_time: last,
            end_time: DateTime::from(DateTime::now().ticks() + 36_000_000_000),
            num_values_per_node: 0,
            return_bounds: false,
        });
        let of = HistoryReadValueId { node_id: node, ..Default::default() };
        let mut found =
            self.session.history_read(wanted, TimestampsToReturn::Both, false, &[of]).await?;
        let data = found.remove(0).history_data.into_inner_as::<HistoryData>();
        Ok(data.ok_or("the history is no HistoryData")?.data_values.unwrap_or_default())
    }

    fn show(&mut self, value: DataValue, left: &mut usize) {
        let (Some(time), Some(item)) = (value.source_timestamp, value.value) else {
            return;
        };
        if *left == 0 || item == Variant::Empty || self.last.is_some_and(|last| time <= last) {
            return;
        }
        self.last = Some(time);
        *left -= 1;
        println!("{}", json!({"item": item.to_string()}));
    }

    /// Return the mass of the last item, whose type the server describes.
    async fn gross(&self) -> Outcome<f64> {
        let tree = DataTypeTreeBuilder::new(|_| true).build(&self.session).await?;
        self.session.add_type_loader(Arc::new(DynamicTypeLoader::new(Arc::new(tree))));
        let wanted = ReadValueId::new_value(self.id(".RegisteredWeight"));
        let mut found = self.session.read(&[wanted], TimestampsToReturn::Both, 0.0).await?;
        let Some(Variant::ExtensionObject(weight)) = found.remove(0).value else {
            return Err("the weight is no structure".into());
        };
        let weight = weight.inner_as::<DynamicStructure>().ok_or("the weight has no type")?;
        match weight.get_field_by_name("Gross") {
            Some(Variant::Double(gross)) => Ok(*gross),
            other => Err(format!("Gross is {other:?}").into()),
        }
    }
}

async fn next(events: &mut UnboundedReceiver<Vec<Variant>>, acknowledged: bool) -> Outcome<Vec<Variant>> {
    loop {
        let event = events.recv().await.ok_or("no further events")?;
        if event[3] == Variant::Boolean(true) && event[4] == Variant::Boolean(acknowledged) {
            return Ok(event);
        }
    }
}
