//! Definitions to Rust source.
//!
//! Names are relative (`super::super::std_msgs::msg::Header`), so that the text can be included
//! into any module.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::{self, Write};

use crate::description::{DescribeError, describe};
use crate::hash::type_hash;
use crate::parser::{
    Constant, Container, DefaultValue, Element, Field, InterfaceKind, Literal, MessageDefinition,
    Primitive, TypeName,
};

/// Error of definitions that have no Rust form.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GenerateError {
    /// A type refers to one that is not there, or to itself.
    #[error(transparent)]
    Describe(#[from] DescribeError),
    /// The source could not be put together.
    #[error("could not write the source: {0}")]
    Format(#[from] fmt::Error),
}

/// Definitions by the names of their types.
pub(crate) type Definitions = BTreeMap<TypeName, MessageDefinition>;

/// Source of one module a package. It names `wrapyfi_interfaces`, which has the structs of the types in `ours`.
///
/// `texts` are the definition files of the others, by path: a program has them at hand, so that it can say what its
/// types are.
pub(crate) fn modules(
    definitions: &Definitions,
    ours: &BTreeSet<TypeName>,
    texts: Option<&BTreeMap<String, String>>,
) -> Result<String, GenerateError> {
    // All are described first: that finds missing and recursive types before their size is asked.
    let mut hashes = Vec::with_capacity(definitions.len());
    for definition in definitions.values() {
        hashes.push(type_hash(&describe(definition, definitions)?));
    }
    let mut packages: BTreeMap<&str, BTreeMap<InterfaceKind, String>> = BTreeMap::new();
    for (definition, hash) in definitions.values().zip(&hashes) {
        let name = &definition.name;
        let package = packages.entry(name.package()).or_default();
        let module = package.entry(name.kind()).or_default();
        let whole = *name == name.interface();
        let is_part = ["_SendGoal", "_GetResult"].iter().any(|end| name.name().ends_with(end));
        match name.kind() {
            _ if ours.contains(name) => {
                let (package, kind, name) = path(name);
                writeln!(module, "pub use ::wrapyfi_interfaces::{package}::{kind}::{name};")?;
            }
            InterfaceKind::Service if whole => service(module, name, definitions, hash)?,
            InterfaceKind::Action if whole => action(module, name, hash)?,
            InterfaceKind::Action if is_part => service(module, name, definitions, hash)?,
            _ => message(module, definition, hash, texts.is_some())?,
        }
    }
    let mut source = String::new();
    // Lints of a program are for what its author writes.
    let lints = texts.map_or("", |_| FOREIGN_LINTS);
    for (package, kinds) in packages {
        let module = rust_name(package);
        write!(
            source,
            "/// Interfaces of the ROS 2 package `{package}`.\n{lints}pub mod {module} {{\n"
        )?;
        for (kind, types) in kinds {
            let (doc, lints) = match kind {
                InterfaceKind::Message => ("Messages.", ""),
                InterfaceKind::Service => {
                    ("Services, with what a client sends and a server answers.", NAME_LINT)
                }
                InterfaceKind::Action => {
                    ("Actions, with goal, result, feedback and what carries them.", NAME_LINT)
                }
            };
            write!(
                source,
                "/// {doc}\n{lints}\
                 #[allow(clippy::approx_constant, clippy::derivable_impls, clippy::upper_case_acronyms)]\n\
                 pub mod {} {{\n{types}}}\n",
                kind.as_str()
            )?;
        }
        source.push_str("}\n");
    }
    if let Some(texts) = texts {
        let texts = texts.iter().collect::<Vec<_>>();
        writeln!(
            source,
            "/// Definitions of the types above.\n\
             fn types() -> ::wrapyfi_interfaces::store::TypeStore {{\n\
             ::wrapyfi_interfaces::store::TypeStore::of_texts(&{texts:#?}).or_generated()\n}}"
        )?;
    }
    Ok(source)
}

/// Package, kind and name of a type as Rust writes them.
fn path(name: &TypeName) -> (String, &'static str, String) {
    (rust_name(name.package()), name.kind().as_str(), rust_name(name.name()))
}

/// Trait of what has a form in CDR.
const VALUE: &str = "::wrapyfi_interfaces::cdr::CdrValue";

/// A program uses some of the types, and may keep all to itself.
const FOREIGN_LINTS: &str = "#[allow(clippy::all, clippy::pedantic, dead_code, missing_docs, unreachable_pub, unused_imports)]\n";

/// `SetBool_Request` is the name that ROS gives.
const NAME_LINT: &str = "#[allow(non_camel_case_types)]\n";

/// The type that stands for a service as a whole.
fn service(
    out: &mut String,
    name: &TypeName,
    definitions: &Definitions,
    hash: &str,
) -> Result<(), GenerateError> {
    let ident = rust_name(name.name());
    let request = definitions.get(&name.derived("_Request"));
    docs(out, request.map_or(&[], |request| &request.doc), &format!("`{name}`"))?;
    writeln!(
        out,
        "#[derive(Debug, Clone, Copy, PartialEq, Eq)]\npub struct {ident};\n\
         impl ::wrapyfi_interfaces::Service for {ident} {{\n\
         type Request = {ident}_Request;\n\
         type Response = {ident}_Response;\n\
         type Event = {ident}_Event;\n\
         const ROS_TYPE: &'static str = \"{name}\";\n\
         const TYPE_HASH: &'static str = \"{hash}\";\n}}"
    )?;
    Ok(())
}

/// The type that stands for an action as a whole.
fn action(out: &mut String, name: &TypeName, hash: &str) -> Result<(), GenerateError> {
    let ident = rust_name(name.name());
    docs(out, &[], &format!("`{name}`"))?;
    writeln!(
        out,
        "#[derive(Debug, Clone, Copy, PartialEq, Eq)]\npub struct {ident};\n\
         impl ::wrapyfi_interfaces::Action for {ident} {{"
    )?;
    for part in ["Goal", "Result", "Feedback", "SendGoal", "GetResult", "FeedbackMessage"] {
        writeln!(out, "type {part} = {ident}_{part};")?;
    }
    writeln!(
        out,
        "const ROS_TYPE: &'static str = \"{name}\";\n\
         const TYPE_HASH: &'static str = \"{hash}\";\n}}"
    )?;
    Ok(())
}

fn message(
    out: &mut String,
    definition: &MessageDefinition,
    hash: &str,
    has_texts: bool,
) -> Result<(), GenerateError> {
    let MessageDefinition { name, doc, fields, constants } = definition;
    let ident = rust_name(name.name());

    docs(out, doc, &format!("`{name}`"))?;
    writeln!(out, "#[derive(Debug, Clone, PartialEq)]\npub struct {ident} {{")?;
    for field in fields {
        docs(out, &field.doc, "")?;
        writeln!(out, "pub {}: {},", rust_name(&field.name), rust_type(field))?;
    }
    writeln!(out, "}}")?;

    writeln!(
        out,
        "impl ::core::default::Default for {ident} {{\nfn default() -> Self {{\nSelf {{"
    )?;
    for field in fields {
        writeln!(out, "{}: {},", rust_name(&field.name), default_value(field))?;
    }
    writeln!(out, "}}\n}}\n}}")?;

    if !constants.is_empty() {
        writeln!(out, "impl {ident} {{")?;
        for constant in constants {
            docs(out, &constant.doc, "")?;
            let Constant { name, element, value, .. } = constant;
            let constant_type = match element {
                Element::Primitive(primitive) => rust_primitive(*primitive),
                _ => "&'static str",
            };
            writeln!(out, "pub const {name}: {constant_type} = {};", literal(element, value))?;
        }
        writeln!(out, "}}")?;
    }

    writeln!(
        out,
        "impl ::wrapyfi_interfaces::Message for {ident} {{\n\
         const ROS_TYPE: &'static str = \"{name}\";\n\
         const DDS_TYPE: &'static str = \"{}\";\n\
         const TYPE_HASH: &'static str = \"{hash}\";",
        name.dds()
    )?;
    if has_texts {
        writeln!(
            out,
            "fn types() -> ::wrapyfi_interfaces::store::TypeStore {{ super::super::types() }}"
        )?;
    }
    writeln!(out, "}}")?;
    // A message without fields has a hidden one of a byte.
    let sizes = fields.iter().map(|field| format!("<{} as {VALUE}>::MIN_SIZE", rust_type(field)));
    let size =
        if fields.is_empty() { "1".to_owned() } else { sizes.collect::<Vec<_>>().join(" + ") };
    writeln!(out, "impl {VALUE} for {ident} {{\nconst MIN_SIZE: usize = {size};")?;
    writeln!(out, "fn write(&self, writer: &mut ::wrapyfi_interfaces::cdr::CdrWriter) {{")?;
    for field in fields {
        writeln!(out, "{VALUE}::write(&self.{}, writer);", rust_name(&field.name))?;
    }
    if fields.is_empty() {
        writeln!(out, "writer.write_primitive(0_u8);")?;
    }
    writeln!(
        out,
        "}}\nfn read(reader: &mut ::wrapyfi_interfaces::cdr::CdrReader<'_>) \
         -> ::core::result::Result<Self, ::wrapyfi_interfaces::cdr::CdrError> {{"
    )?;
    if fields.is_empty() {
        writeln!(out, "reader.read_primitive::<u8>()?;")?;
    }
    writeln!(out, "::core::result::Result::Ok(Self {{")?;
    for field in fields {
        let Field { name, .. } = field;
        let ident = rust_name(name);
        writeln!(
            out,
            "{ident}: {VALUE}::read(reader).map_err(|error| error.in_field({name:?}))?,"
        )?;
    }
    writeln!(out, "}})\n}}\n}}")?;
    Ok(())
}

/// Comment lines of the definition as documentation, then a line of our own.
fn docs(out: &mut String, lines: &[String], last: &str) -> Result<(), GenerateError> {
    for line in lines {
        writeln!(out, "#[doc = {:?}]", markdown(line))?;
    }
    if lines.is_empty() && last.is_empty() {
        writeln!(out, "#[doc = \"Not described in the definition.\"]")?;
    }
    if !last.is_empty() {
        writeln!(out, "#[doc = \"\"]\n#[doc = {last:?}]")?;
    }
    Ok(())
}

/// Escapes what rustdoc would take for a link or a tag; code in backquotes stays as it is.
fn markdown(line: &str) -> String {
    let mut code = false;
    let mut escaped = String::with_capacity(line.len());
    for c in line.chars() {
        code ^= c == '`';
        if !code && matches!(c, '[' | ']' | '<' | '>') {
            escaped.push('\\');
        }
        escaped.push(c);
    }
    escaped
}

/// A name as Rust writes it, where ROS allows words that Rust keeps for itself.
fn rust_name(name: &str) -> String {
    const KEYWORDS: &[&str] = &[
        "abstract", "as", "async", "await", "become", "box", "break", "const", "continue", "do",
        "dyn", "else", "enum", "extern", "false", "final", "fn", "for", "gen", "if", "impl", "in",
        "let", "loop", "macro", "match", "mod", "move", "mut", "override", "priv", "pub", "ref",
        "return", "static", "struct", "trait", "true", "try", "type", "typeof", "unsafe",
        "unsized", "use", "virtual", "where", "while", "yield",
    ];
    match name {
        // These cannot be raw identifiers.
        "self" | "super" | "crate" | "Self" => format!("{name}_"),
        name if KEYWORDS.contains(&name) => format!("r#{name}"),
        name => name.to_owned(),
    }
}

fn rust_primitive(primitive: Primitive) -> &'static str {
    match primitive {
        Primitive::Bool => "bool",
        Primitive::Byte | Primitive::Char | Primitive::Uint8 => "u8",
        Primitive::Int8 => "i8",
        Primitive::Int16 => "i16",
        Primitive::Uint16 => "u16",
        Primitive::Int32 => "i32",
        Primitive::Uint32 => "u32",
        Primitive::Int64 => "i64",
        Primitive::Uint64 => "u64",
        Primitive::Float32 => "f32",
        Primitive::Float64 => "f64",
    }
}

fn rust_element(element: &Element) -> String {
    match element {
        Element::Primitive(primitive) => rust_primitive(*primitive).to_owned(),
        Element::String { .. } => "::std::string::String".to_owned(),
        Element::WString { .. } => "::wrapyfi_interfaces::cdr::WString".to_owned(),
        Element::Nested(name) => {
            let (package, kind, name) = path(name);
            format!("super::super::{package}::{kind}::{name}")
        }
    }
}

/// True for sequences that are held as shared bytes.
fn is_bytes(field: &Field) -> bool {
    let Container::Sequence { .. } = field.field_type.container else { return false };
    match field.field_type.element {
        Element::Primitive(primitive) => rust_primitive(primitive) == "u8",
        _ => false,
    }
}

fn rust_type(field: &Field) -> String {
    let element = rust_element(&field.field_type.element);
    match field.field_type.container {
        Container::Single => element,
        Container::Array(size) => format!("[{element}; {size}]"),
        Container::Sequence { .. } if is_bytes(field) => {
            "::wrapyfi_interfaces::cdr::Bytes".to_owned()
        }
        Container::Sequence { .. } => format!("::std::vec::Vec<{element}>"),
    }
}

fn default_value(field: &Field) -> String {
    let element = &field.field_type.element;
    let values: Option<Vec<String>> = field.default.as_ref().map(|default| match default {
        DefaultValue::One(value) => vec![owned(element, value)],
        DefaultValue::Many(values) => values.iter().map(|value| owned(element, value)).collect(),
    });
    match (field.field_type.container, values) {
        (Container::Single, Some(values)) => values.concat(),
        (Container::Single, None) => "::core::default::Default::default()".to_owned(),
        (Container::Array(_), Some(values)) => format!("[{}]", values.join(", ")),
        (Container::Array(_), None) => {
            "::core::array::from_fn(|_| ::core::default::Default::default())".to_owned()
        }
        (Container::Sequence { .. }, Some(values)) if is_bytes(field) => {
            format!("::wrapyfi_interfaces::cdr::Bytes::from_static(&[{}])", values.join(", "))
        }
        (Container::Sequence { .. }, Some(values)) => format!("::std::vec![{}]", values.join(", ")),
        (Container::Sequence { .. }, None) => "::core::default::Default::default()".to_owned(),
    }
}

fn owned(element: &Element, value: &Literal) -> String {
    match value {
        Literal::Text(_) => format!("{}::from({})", rust_element(element), literal(element, value)),
        _ => literal(element, value),
    }
}

fn literal(element: &Element, value: &Literal) -> String {
    let number = match element {
        Element::Primitive(primitive) => rust_primitive(*primitive),
        _ => "",
    };
    match value {
        Literal::Bool(value) => value.to_string(),
        Literal::Integer(value) => format!("{value}_{number}"),
        Literal::Float(value) if value.is_nan() => format!("{number}::NAN"),
        Literal::Float(value) if value.is_infinite() && value.is_sign_positive() => {
            format!("{number}::INFINITY")
        }
        Literal::Float(value) if value.is_infinite() => format!("{number}::NEG_INFINITY"),
        Literal::Float(value) => format!("{value:?}_{number}"),
        Literal::Text(value) => format!("{value:?}"),
    }
}
