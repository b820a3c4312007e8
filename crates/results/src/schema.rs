//! The documents that commands print, and their JSON Schemas.

use std::borrow::Cow;

use schemars::generate::SchemaSettings;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};

use crate::{
    Bisection, Campaign, Check, Comparison, Controller, ControllerExport, ControllerImport, Counterexamples,
    Demonstrations, Evaluation, Evidence, EvidenceVerification, Explanation, Exports, Falsification,
    FormulaDescription, GuardTuning, Hardening, Listing, LogExplanations, Margin, Masking, Mining, Monitor,
    MonitorChange, Named, Number, ProtocolCheck, Regression, Replay, Risk, RunDifference, RunSummary,
    SampleSize, Seed, Simulation, Training, TrainingPlan,
};

/// A document that a command prints with `--json`.
#[derive(Clone, Copy, Debug)]
pub struct Document {
    /// The command.
    pub command: &'static str,
    /// Name of the type.
    pub name: &'static str,
    /// Whether the command prints an array of such objects.
    pub is_array: bool,
    make: fn() -> Schema,
}

impl Document {
    /// Returns all documents, in the order of the reference.
    pub fn all() -> Vec<Document> {
        vec![
            Document::object::<Listing>("list"),
            Document::object::<ProtocolCheck>("init --check"),
            Document::object::<Monitor>("monitor"),
            Document::object::<MonitorChange>("monitor --follow"),
            Document::object::<FormulaDescription>("formula"),
            Document::object::<Mining>("mine"),
            Document::object::<Evaluation>("evaluate"),
            Document::object::<Falsification>("falsify"),
            Document::object::<Margin>("margin"),
            Document::object::<Risk>("risk"),
            Document::object::<Simulation>("simulate"),
            Document::object::<Check>("check"),
            Document::object::<Campaign>("run"),
            Document::object::<Comparison>("compare"),
            Document::object::<RunDifference>("compare --exact"),
            Document::object::<SampleSize>("evaluate --expect"),
            Document::array::<RunSummary>("runs"),
            Document::object::<Replay>("replay"),
            Document::object::<Explanation>("explain"),
            Document::object::<LogExplanations>("explain --log"),
            Document::object::<Masking>("explain --masking"),
            Document::object::<Counterexamples>("counterexamples"),
            Document::object::<Exports>("counterexamples export"),
            Document::object::<Regression>("regress"),
            Document::object::<Evidence>("evidence"),
            Document::object::<EvidenceVerification>("evidence --verify"),
            Document::object::<Bisection>("bisect"),
            Document::object::<Demonstrations>("record"),
            Document::object::<Training>("train"),
            Document::object::<Hardening>("harden"),
            Document::object::<TrainingPlan>("train --dry-run"),
            Document::object::<GuardTuning>("guard"),
            Document::object::<Controller>("controller"),
            Document::object::<ControllerExport>("controller --out"),
            Document::object::<ControllerImport>("controller --task"),
        ]
    }

    fn object<T: JsonSchema>(command: &'static str) -> Document {
        let name = std::any::type_name::<T>().rsplit("::").next().unwrap_or_default();
        Document { command, name, is_array: false, make: schema::<T> }
    }

    fn array<T: JsonSchema>(command: &'static str) -> Document {
        Document { is_array: true, ..Document::object::<T>(command) }
    }

    /// Returns the JSON Schema of an object of the document, without the key `schema`. Other types
    /// are in `$defs`.
    pub fn schema(&self) -> Schema {
        (self.make)()
    }
}

fn schema<T: JsonSchema>() -> Schema {
    SchemaSettings::draft2020_12().for_serialize().into_generator().into_root_schema_for::<T>()
}

impl JsonSchema for Number {
    fn schema_name() -> Cow<'static, str> {
        "Number".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "anyOf": [{ "type": "number" }, { "enum": ["inf", "-inf"] }] })
    }
}

impl JsonSchema for Seed {
    fn schema_name() -> Cow<'static, str> {
        "Seed".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": "string", "pattern": "^[0-9]+$" })
    }
}

impl<T: JsonSchema> JsonSchema for Named<T> {
    fn inline_schema() -> bool {
        true
    }

    fn schema_name() -> Cow<'static, str> {
        format!("Named{}", T::schema_name()).into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let value = generator.subschema_for::<T>();
        json_schema!({ "type": "object", "additionalProperties": value })
    }
}
