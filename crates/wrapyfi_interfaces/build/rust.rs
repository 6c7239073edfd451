//! Definitions to Rust source.
//!
//! Names are relative (`super::super::std_msgs::msg::Header`), so that the text can be included
//! into any module.

use std::collections::BTreeMap;
use std::fmt::{self, Write};

use crate::description::describe;
use crate::hash::type_hash;
use crate::parser::{
    Constant, Container, DefaultValue, Element, Field, InterfaceKind, Literal, MessageDefinition,
    Primitive, TypeName,
};
use crate::{BuildError, Definitions};

/// Error of a definition that has no Rust form.
#[derive(Debug, thiserror::Error)]
pub(crate) enum GenerateError {
    #[error(
        "{message}: field {field:?} is a wstring, which the generator does not know; \
         add it to build/rust.rs and the CDR reader and writer"
    )]
    WString { message: TypeName, field: String },
    #[error("could not write the source: {0}")]
    Format(#[from] fmt::Error),
}

/// Source of one module a package.
pub(crate) fn modules(definitions: &Definitions) -> Result<String, BuildError> {
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
        if name.kind() == InterfaceKind::Service && *name == name.interface() {
            service(module, name, definitions, hash)?;
        } else {
            message(module, definition, hash)?;
        }
    }
    let mut source = String::new();
    for (package, kinds) in packages {
        write!(source, "/// Interfaces of the ROS 2 package `{package}`.\npub mod {package} {{\n")
            .map_err(GenerateError::from)?;
        for (kind, types) in kinds {
            let (doc, lints) = match kind {
                InterfaceKind::Service => {
                    ("Services, with what a client sends and a server answers.", NAME_LINT)
                }
                _ => ("Messages.", ""),
            };
            write!(
                source,
                "/// {doc}\n{lints}\
                 #[allow(clippy::approx_constant, clippy::derivable_impls, clippy::upper_case_acronyms)]\n\
                 pub mod {} {{\n{types}}}\n",
                kind.as_str()
            )
            .map_err(GenerateError::from)?;
        }
        source.push_str("}\n");
    }
    Ok(source)
}

/// Trait of what has a form in CDR.
const VALUE: &str = "crate::cdr::CdrValue";

/// `SetBool_Request` is the name that ROS gives.
const NAME_LINT: &str = "#[allow(non_camel_case_types)]\n";

/// The type that stands for a service as a whole.
fn service(
    out: &mut String,
    name: &TypeName,
    definitions: &Definitions,
    hash: &str,
) -> Result<(), GenerateError> {
    let ident = name.name();
    let request = definitions.get(&name.derived("_Request"));
    docs(out, request.map_or(&[], |request| &request.doc), &format!("`{name}`"))?;
    writeln!(
        out,
        "#[derive(Debug, Clone, Copy, PartialEq, Eq)]\npub struct {ident};\n\
         impl crate::Service for {ident} {{\n\
         type Request = {ident}_Request;\n\
         type Response = {ident}_Response;\n\
         type Event = {ident}_Event;\n\
         const ROS_TYPE: &'static str = \"{name}\";\n\
         const TYPE_HASH: &'static str = \"{hash}\";\n}}"
    )?;
    Ok(())
}

fn message(
    out: &mut String,
    definition: &MessageDefinition,
    hash: &str,
) -> Result<(), GenerateError> {
    let MessageDefinition { name, doc, fields, constants } = definition;
    for field in fields {
        if matches!(field.field_type.element, Element::WString { .. }) {
            let field = field.name.clone();
            return Err(GenerateError::WString { message: name.clone(), field });
        }
    }
    let ident = name.name();

    docs(out, doc, &format!("`{name}`"))?;
    writeln!(out, "#[derive(Debug, Clone, PartialEq)]\npub struct {ident} {{")?;
    for field in fields {
        docs(out, &field.doc, "")?;
        writeln!(out, "pub {}: {},", field_ident(&field.name), rust_type(field))?;
    }
    writeln!(out, "}}")?;

    writeln!(
        out,
        "impl ::core::default::Default for {ident} {{\nfn default() -> Self {{\nSelf {{"
    )?;
    for field in fields {
        writeln!(out, "{}: {},", field_ident(&field.name), default_value(field))?;
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
        "impl crate::Message for {ident} {{\n\
         const ROS_TYPE: &'static str = \"{name}\";\n\
         const DDS_TYPE: &'static str = \"{}\";\n\
         const TYPE_HASH: &'static str = \"{hash}\";\n}}",
        name.dds()
    )?;
    // A message without fields has a hidden one of a byte.
    let sizes = fields.iter().map(|field| format!("<{} as {VALUE}>::MIN_SIZE", rust_type(field)));
    let size =
        if fields.is_empty() { "1".to_owned() } else { sizes.collect::<Vec<_>>().join(" + ") };
    writeln!(out, "impl {VALUE} for {ident} {{\nconst MIN_SIZE: usize = {size};")?;
    writeln!(out, "fn write(&self, writer: &mut crate::cdr::CdrWriter) {{")?;
    for field in fields {
        writeln!(out, "{VALUE}::write(&self.{}, writer);", field_ident(&field.name))?;
    }
    if fields.is_empty() {
        writeln!(out, "writer.write_primitive(0_u8);")?;
    }
    writeln!(
        out,
        "}}\nfn read(reader: &mut crate::cdr::CdrReader<'_>) \
         -> ::core::result::Result<Self, crate::cdr::CdrError> {{"
    )?;
    if fields.is_empty() {
        writeln!(out, "reader.read_primitive::<u8>()?;")?;
    }
    writeln!(out, "::core::result::Result::Ok(Self {{")?;
    for field in fields {
        let Field { name, .. } = field;
        let ident = field_ident(name);
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

fn field_ident(name: &str) -> String {
    const KEYWORDS: &[&str] = &[
        "abstract", "as", "async", "await", "become", "box", "break", "const", "continue", "do",
        "dyn", "else", "enum", "extern", "false", "final", "fn", "for", "gen", "if", "impl", "in",
        "let", "loop", "macro", "match", "mod", "move", "mut", "override", "priv", "pub", "ref",
        "return", "static", "struct", "trait", "true", "try", "type", "unsafe", "use", "where",
        "while",
    ];
    match name {
        // These cannot be raw identifiers.
        "self" | "super" | "crate" => format!("{name}_"),
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
        Element::String { .. } | Element::WString { .. } => "::std::string::String".to_owned(),
        Element::Nested(name) => {
            format!("super::super::{}::{}::{}", name.package(), name.kind().as_str(), name.name())
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
        Container::Sequence { .. } if is_bytes(field) => "::bytes::Bytes".to_owned(),
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
            format!("::bytes::Bytes::from_static(&[{}])", values.join(", "))
        }
        (Container::Sequence { .. }, Some(values)) => format!("::std::vec![{}]", values.join(", ")),
        (Container::Sequence { .. }, None) => "::core::default::Default::default()".to_owned(),
    }
}

fn owned(element: &Element, value: &Literal) -> String {
    match value {
        Literal::Text(_) => format!("::std::string::String::from({})", literal(element, value)),
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
