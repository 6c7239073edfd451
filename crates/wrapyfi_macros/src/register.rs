//! Arguments of one `#[register(…)]`.
//!
//! ```text
//!   #[register(NativeObject, "$mware", "/topic", should_wait = "$wait", listener_kwargs(in_topic = "/in"))]
//!              data type     texts: [middleware,] [class,] topic          options
//!
//!   #[register([Image, "ros2", "/a"], [AudioChunk, "zeromq", "/b"])]      a returned list
//! ```

use proc_macro2::{Span, TokenStream};
use quote::{ToTokens as _, quote};
use syn::parse::{Parse, ParseStream};
use syn::punctuated::Punctuated;
use syn::spanned::Spanned as _;
use syn::{Expr, ExprLit, Ident, Lit, LitStr, Token, UnOp, bracketed, parenthesized};

use crate::options::{self, ValueKind};
use crate::suggest::{did_you_mean, listed, wrong};

const DATA_TYPES: [&str; 6] =
    ["NativeObject", "Image", "AudioChunk", "Properties", "RosMessage", ACTION];
/// Word for a method that is an action. Its value is a native object.
const ACTION: &str = "Action";
/// Wrapyfi's names for the last one.
const OF_WRAPYFI: [&str; 2] = ["ROSMessage", "ROS2Message"];

/// One `#[register]`: one returned value, or a list of them.
pub(crate) enum Registration {
    /// A value with a topic of its own.
    One(Box<Register>),
    /// The members of a returned list, with a topic each.
    List(Vec<Register>),
}

/// Type, place and options of one value.
pub(crate) struct Register {
    /// One of `DATA_TYPES`; that of its value for an action.
    pub(crate) data_type: Ident,
    pub(crate) is_action: bool,
    /// Text or constant; `None` is the default middleware.
    pub(crate) middleware: Option<Expr>,
    /// Text or constant.
    pub(crate) topic: Expr,
    pub(crate) options: Vec<Setting>,
}

/// `name = value` or `name(…)`.
pub(crate) struct Setting {
    pub(crate) name: String,
    span: Span,
    value_span: Span,
    pub(crate) value: SettingValue,
}

pub(crate) enum SettingValue {
    Switch(bool),
    Integer(i64),
    Float(f64),
    Text(LitStr),
    Map(Vec<Setting>),
}

impl Parse for Registration {
    fn parse(input: ParseStream<'_>) -> syn::Result<Self> {
        if !input.peek(syn::token::Bracket) {
            return Register::parse(input).map(|one| Self::One(Box::new(one)));
        }
        let mut members = Vec::new();
        while !input.is_empty() {
            if !input.peek(syn::token::Bracket) {
                return Err(input.error(
                    "a list return has one bracket for each member: [NativeObject, \"zeromq\", \"/a\"], …",
                ));
            }
            let member;
            bracketed!(member in input);
            if member.peek(syn::token::Bracket) {
                return Err(member.error(
                    "a list return is one level deep: give the inner list's members a bracket each in \
                     this list, and return them in one tuple",
                ));
            }
            members.push(Register::parse(&member)?);
            if !input.is_empty() {
                input.parse::<Token![,]>()?;
            }
        }
        Ok(Self::List(members))
    }
}

impl Registration {
    pub(crate) fn registers(&self) -> &[Register] {
        match self {
            Self::One(register) => std::slice::from_ref(&**register),
            Self::List(members) => members,
        }
    }
}

impl Parse for Register {
    fn parse(input: ParseStream<'_>) -> syn::Result<Self> {
        let data_type = data_type(input)?;
        let mut texts = Vec::<Expr>::new();
        let mut options = Vec::<Setting>::new();
        while !input.is_empty() {
            input.parse::<Token![,]>()?;
            if input.is_empty() {
                break;
            }
            let named =
                input.peek(Ident) && (input.peek2(Token![=]) || input.peek2(syn::token::Paren));
            if named {
                options.push(input.parse()?);
            } else if input.peek(syn::token::Brace) {
                return Err(input.error("write options as name = value, without braces"));
            } else if options.is_empty() {
                texts.push(text(input)?);
            } else {
                return Err(input.error("middleware and topic stand before the options"));
            }
        }
        check(&options, false)?;
        Self::assemble(data_type, texts, options)
    }
}

impl Register {
    /// Assigns the texts by their number, as Python does: middleware, class, topic.
    fn assemble(
        data_type: Ident,
        texts: Vec<Expr>,
        mut options: Vec<Setting>,
    ) -> syn::Result<Self> {
        let span = data_type.span();
        let mut named = |name: &str| -> syn::Result<Option<Expr>> {
            let Some(at) = options.iter().position(|setting| setting.name == name) else {
                return Ok(None);
            };
            match options.remove(at).value {
                SettingValue::Text(text) => {
                    Ok(Some(Expr::Lit(ExprLit { attrs: Vec::new(), lit: Lit::Str(text) })))
                }
                _ => wrong(span, format!("{name} is a text: {name} = \"…\"")),
            }
        };
        let (named_middleware, named_topic) = (named("middleware")?, named("topic")?);
        let mut texts = texts.into_iter();
        let (middleware, topic) = match (texts.next(), texts.next(), texts.next(), texts.next()) {
            (first, None, ..) if named_topic.is_some() => (first, None),
            (None, ..) => (None, None),
            (Some(topic), None, ..) => (None, Some(topic)),
            (Some(middleware), Some(topic), None, _) => (Some(middleware), Some(topic)),
            // The class name of Python's signature is the type's name here.
            (Some(middleware), Some(_class), Some(topic), None) => (Some(middleware), Some(topic)),
            (.., Some(extra)) => {
                return wrong(
                    extra.span(),
                    "too many texts: write data type, middleware, topic, and options by name",
                );
            }
        };
        let once = |what: &str, one: Option<Expr>, named: Option<Expr>| match (one, named) {
            (Some(_), Some(named)) => {
                wrong(named.span(), format!("{what} is given twice: leave one of them out"))
            }
            (one, other) => Ok(one.or(other)),
        };
        let middleware = once("the middleware", middleware, named_middleware)?;
        let Some(topic) = once("the topic", topic, named_topic)? else {
            let text = format!("no topic: write #[register({data_type}, \"zeromq\", \"/name\")]");
            return wrong(span, text);
        };
        for text in middleware.iter().chain([&topic]) {
            check_dollar(text)?;
        }
        if let Expr::Lit(ExprLit { lit: Lit::Str(text), .. }) = &topic
            && text.value().is_empty()
        {
            return wrong(text.span(), "an empty topic: write a name such as \"/camera\"");
        }
        let is_action = data_type == ACTION;
        match (is_action, options.iter().find(|setting| setting.name == "action_type")) {
            (true, None) => wrong(
                span,
                "an action has a type: #[register(Action, \"ros2\", \"/name\", action_type = \"package/action/Type\")]",
            ),
            (false, Some(setting)) => wrong(
                setting.span,
                "`action_type` makes an action: write the data type Action, or leave it out",
            ),
            (true, Some(_)) => {
                let data_type = Ident::new("NativeObject", span);
                Ok(Self { data_type, is_action, middleware, topic, options })
            }
            (false, None) => Ok(Self { data_type, is_action, middleware, topic, options }),
        }
    }

    /// Every text that may begin with `$`.
    pub(crate) fn texts(&self) -> Vec<&LitStr> {
        let mut found = Vec::new();
        for expr in self.middleware.iter().chain([&self.topic]) {
            if let Expr::Lit(ExprLit { lit: Lit::Str(text), .. }) = expr {
                found.push(text);
            }
        }
        collect_texts(&self.options, &mut found);
        found
    }

    /// As a constant of `wrapyfi_core::communicator::Register`, for a value of the type `returned`.
    pub(crate) fn constant(
        &self,
        communicator: &TokenStream,
        returned: &TokenStream,
    ) -> TokenStream {
        let Self { data_type, middleware, topic, options, .. } = self;
        let middleware = match middleware {
            Some(text) => quote!(::core::option::Option::Some(#text)),
            None => quote!(::core::option::Option::None),
        };
        let options = settings(options, communicator);
        let ros_type = if data_type == "RosMessage" {
            quote!(<#returned as #communicator::Returned<#communicator::kind::RosMessage>>::ROS_TYPE)
        } else {
            quote!(::core::option::Option::None)
        };
        quote! {
            #communicator::Register {
                data_type: #communicator::DataType::#data_type,
                middleware: #middleware,
                topic: #topic,
                options: &#options,
                ros_type: #ros_type,
            }
        }
    }
}

fn collect_texts<'a>(settings: &'a [Setting], found: &mut Vec<&'a LitStr>) {
    for setting in settings {
        match &setting.value {
            SettingValue::Text(text) => found.push(text),
            SettingValue::Map(inner) => collect_texts(inner, found),
            _ => {}
        }
    }
}

fn settings(settings: &[Setting], communicator: &TokenStream) -> TokenStream {
    let pairs = settings.iter().map(|Setting { name, value, .. }| {
        let value = match value {
            SettingValue::Switch(value) => quote!(Switch(#value)),
            SettingValue::Integer(value) => quote!(Integer(#value)),
            SettingValue::Float(value) => quote!(Float(#value)),
            SettingValue::Text(value) => quote!(Text(#value)),
            SettingValue::Map(inner) => {
                let inner = self::settings(inner, communicator);
                quote!(Map(&#inner))
            }
        };
        quote!((#name, #communicator::Literal::#value))
    });
    quote!([#(#pairs),*])
}

/// The first word.
fn data_type(input: ParseStream<'_>) -> syn::Result<Ident> {
    let (word, span) = if input.peek(LitStr) {
        let text: LitStr = input.parse()?;
        (text.value(), text.span())
    } else if input.peek(Ident) {
        let path: syn::Path = input.parse()?;
        let word = path.segments.last().map(|last| last.ident.to_string()).unwrap_or_default();
        (word, path.span())
    } else {
        let text = format!(
            "the data type comes first, one of {}: #[register(NativeObject, \"zeromq\", \"/topic\")]",
            listed(DATA_TYPES)
        );
        return Err(if input.is_empty() {
            syn::Error::new(Span::call_site(), text)
        } else {
            input.error(text)
        });
    };
    if DATA_TYPES.contains(&word.as_str()) {
        return Ok(Ident::new(&word, span));
    }
    if OF_WRAPYFI.contains(&word.as_str()) {
        return Ok(Ident::new("RosMessage", span));
    }
    let hint = did_you_mean(&word, DATA_TYPES.into_iter().chain(OF_WRAPYFI));
    let text =
        format!("`{word}` is no data type here; {hint}data types are {}", listed(DATA_TYPES));
    wrong(span, text)
}

/// A text, or a constant that is one.
fn text(input: ParseStream<'_>) -> syn::Result<Expr> {
    let expr: Expr = input.parse()?;
    match &expr {
        Expr::Lit(ExprLit { lit: Lit::Str(_), .. }) | Expr::Path(_) | Expr::Macro(_) => Ok(expr),
        _ => wrong(
            expr.span(),
            "a text or a constant should be here: data type, \"middleware\", \"/topic\", then name = value",
        ),
    }
}

impl Parse for Setting {
    fn parse(input: ParseStream<'_>) -> syn::Result<Self> {
        let (name, span) = if input.peek(LitStr) {
            let key: LitStr = input.parse()?;
            (key.value(), key.span())
        } else {
            let key: Ident = input.parse()?;
            (key.to_string(), key.span())
        };
        if input.peek(syn::token::Paren) {
            let content;
            parenthesized!(content in input);
            let inner = Punctuated::<Self, Token![,]>::parse_terminated(&content)?;
            let value = SettingValue::Map(inner.into_iter().collect());
            return Ok(Self { name, span, value_span: span, value });
        }
        input.parse::<Token![=]>()?;
        let expr: Expr = input.parse()?;
        let value = SettingValue::from_expr(&expr)?;
        Ok(Self { name, span, value_span: expr.span(), value })
    }
}

impl SettingValue {
    fn from_expr(expr: &Expr) -> syn::Result<Self> {
        let (lit, negative) = match expr {
            Expr::Lit(ExprLit { lit, .. }) => (lit, false),
            Expr::Unary(syn::ExprUnary { op: UnOp::Neg(_), expr: inner, .. }) => match &**inner {
                Expr::Lit(ExprLit { lit, .. }) => (lit, true),
                _ => return Self::no_literal(expr),
            },
            _ => return Self::no_literal(expr),
        };
        match lit {
            Lit::Bool(value) if !negative => Ok(Self::Switch(value.value)),
            Lit::Str(text) if !negative => {
                check_dollar(expr)?;
                Ok(Self::Text(text.clone()))
            }
            Lit::Int(number) => {
                let value: i64 = number.base10_parse()?;
                Ok(Self::Integer(if negative { -value } else { value }))
            }
            Lit::Float(number) => {
                let value: f64 = number.base10_parse()?;
                Ok(Self::Float(if negative { -value } else { value }))
            }
            _ => Self::no_literal(expr),
        }
    }

    fn no_literal(expr: &Expr) -> syn::Result<Self> {
        let found = expr.to_token_stream();
        let text = format!(
            "`{found}` is no value of an option: write true, a number or a text, or \"$argument\" for \
             what is known at the first call"
        );
        wrong(expr.span(), text)
    }
}

/// A `$` anywhere but at the beginning would stay as it is.
fn check_dollar(expr: &Expr) -> syn::Result<()> {
    let Expr::Lit(ExprLit { lit: Lit::Str(text), .. }) = expr else { return Ok(()) };
    let value = text.value();
    match value.find('$') {
        None | Some(0) if value != "$" => Ok(()),
        _ => wrong(
            text.span(),
            "`$` stands first and an argument's name or number follows it, such as \"$topic\" or \"$0\": \
             the argument replaces the whole text",
        ),
    }
}

/// Unknown words, values of another kind, words given twice.
fn check(settings: &[Setting], one_side: bool) -> syn::Result<()> {
    for (index, Setting { name, span, value_span, value }) in settings.iter().enumerate() {
        let Some(kind) = options::value_kind(name) else {
            let text = format!(
                "unknown option `{name}`; {}the table of options is in docs/reference/communicator.md",
                did_you_mean(name, options::names())
            );
            return wrong(*span, text);
        };
        if settings.iter().take(index).any(|earlier| earlier.name == *name) {
            return wrong(*span, format!("`{name}` is given twice: leave one out"));
        }
        let fits = match (kind, value) {
            (ValueKind::Side, _) if one_side => {
                let text = format!("`{name}` cannot stand inside options of one side");
                return wrong(*span, text);
            }
            (ValueKind::Side, SettingValue::Map(inner)) => {
                check(inner, true)?;
                true
            }
            (_, SettingValue::Text(text)) if text.value().starts_with('$') => {
                kind != ValueKind::Side
            }
            (ValueKind::Switch | ValueKind::SwitchOrMap, SettingValue::Switch(_))
            | (ValueKind::Number, SettingValue::Integer(_))
            | (ValueKind::Text, SettingValue::Text(_))
            | (ValueKind::Map | ValueKind::SwitchOrMap, SettingValue::Map(_)) => true,
            _ => false,
        };
        if !fits {
            let text = format!("this is no value of `{name}`: write {}", kind.example(name));
            return wrong(*value_span, text);
        }
    }
    Ok(())
}
