//! A method that carries `#[register]`: how it is called and what it returns.
//!
//! ```text
//!   fn read(&self, topic: &str, frames: &[u8], gain: f64) -> (Image, AudioChunk)
//!           kept   Text          Slice           Owned       one for each #[register], in order
//! ```
//!
//! `#[default(value)]` before an argument is its value where a client leaves it out. `#[feedback]` marks the one through
//! which the feedback of an action goes.
//!
//! An argument is lent or given to the body. A server decodes an owned twin of it: `String` for
//! `&str`, `Vec<T>` for `&[T]`, `T` for `&T` and `T`.

use proc_macro2::{Ident, Span, TokenStream, TokenTree};
use quote::{ToTokens as _, format_ident, quote};
use syn::spanned::Spanned as _;
use syn::{Attribute, FnArg, GenericParam, ImplItemFn, Pat, ReturnType, Type};

use crate::register::{Register, Registration};
use crate::suggest::{did_you_mean, listed, wrong};

/// Way in which an argument is passed.
pub(crate) enum Passing {
    /// By value; its twin is of the same type.
    Owned(Type),
    /// `&str`.
    Text,
    /// `&[T]`, with `T`.
    Slice(Type),
    /// `&T`, with `T`.
    Lent(Type),
}

pub(crate) struct Argument {
    pub(crate) name: Ident,
    /// As written, for the wrapper.
    pub(crate) written: Type,
    pub(crate) passing: Passing,
    /// Value of an argument that a client leaves out.
    pub(crate) default: Option<syn::Expr>,
}

pub(crate) struct Method {
    pub(crate) visibility: syn::Visibility,
    pub(crate) docs: Vec<Attribute>,
    pub(crate) name: Ident,
    pub(crate) variant: Ident,
    pub(crate) is_async: bool,
    pub(crate) receiver: TokenStream,
    /// Without those that are marked.
    pub(crate) arguments: Vec<Argument>,
    /// Place among all arguments, name and type of the argument with `#[received]`.
    pub(crate) received: Option<(usize, Ident, Type)>,
    /// The same of the argument with `#[feedback]`.
    pub(crate) feedback: Option<(usize, Ident, Type)>,
    pub(crate) registrations: Vec<Registration>,
    /// Type of each value, as the registrations order them.
    pub(crate) returns: Vec<Type>,
}

/// Takes `#[register]` and the marks of arguments off a method; `None` where it has no `#[register]`.
pub(crate) fn analyse(method: &mut ImplItemFn) -> Option<syn::Result<Method>> {
    let marks = taken(&mut method.attrs, "register");
    let of_arguments = method.sig.inputs.iter_mut().map(|input| match input {
        FnArg::Typed(argument) => ArgumentMarks {
            received: taken(&mut argument.attrs, "received"),
            feedback: taken(&mut argument.attrs, "feedback"),
            default: taken(&mut argument.attrs, "default"),
        },
        FnArg::Receiver(_) => ArgumentMarks::default(),
    });
    let of_arguments: Vec<_> = of_arguments.collect();
    (!marks.is_empty()).then(|| Method::new(method, &marks, &of_arguments))
}

/// Marks that stood before an argument.
#[derive(Default)]
struct ArgumentMarks {
    received: Vec<Attribute>,
    feedback: Vec<Attribute>,
    default: Vec<Attribute>,
}

fn taken(attributes: &mut Vec<Attribute>, name: &str) -> Vec<Attribute> {
    attributes.extract_if(.., |attribute| is(attribute, name)).collect()
}

fn is(attribute: &Attribute, name: &str) -> bool {
    attribute.path().segments.last().is_some_and(|last| last.ident == name)
}

impl Method {
    fn new(
        method: &ImplItemFn,
        marks: &[Attribute],
        of_arguments: &[ArgumentMarks],
    ) -> syn::Result<Self> {
        let signature = &method.sig;
        let name = signature.ident.clone();
        refuse_generics(method)?;
        if let Some(attribute) = method.attrs.iter().find(|attribute| is(attribute, "cfg")) {
            return wrong(
                attribute.span(),
                "a registered method is always there: put #[cfg] on the impl block, or choose mode disable",
            );
        }
        let registrations = marks
            .iter()
            .map(|mark| match &mark.meta {
                syn::Meta::List(list) if !list.tokens.is_empty() => {
                    list.parse_args::<Registration>()
                }
                other => wrong(
                    other.span(),
                    "say what is sent where: #[register(NativeObject, \"zeromq\", \"/topic\")]",
                ),
            })
            .collect::<syn::Result<Vec<_>>>()?;
        let receiver = receiver(signature)?;
        let mut arguments = Vec::new();
        let (mut prev, mut progress) = (None, None);
        // The receiver is input 0.
        let inputs = signature.inputs.iter().zip(of_arguments).enumerate();
        for (index, (input, ArgumentMarks { received, feedback, default })) in inputs.skip(1) {
            let FnArg::Typed(argument) = input else { continue };
            let (name, written) = (argument_name(&argument.pat)?, (*argument.ty).clone());
            let (marked, mark) = match (received.is_empty(), feedback.is_empty()) {
                (true, true) => {
                    let passing = passing(&written)?;
                    let default = default.last().map(default_value).transpose()?;
                    arguments.push(Argument { name, written, passing, default });
                    continue;
                }
                (false, _) => (&mut prev, "received"),
                (true, false) => (&mut progress, "feedback"),
            };
            if marked.is_some() {
                return wrong(name.span(), format!("one argument can be #[{mark}], not two"));
            }
            *marked = Some((index - 1, name, written));
        }
        let returns = returns(&signature.output, &registrations)?;
        let method = Self {
            visibility: method.vis.clone(),
            docs: method.attrs.iter().filter(|attribute| is(attribute, "doc")).cloned().collect(),
            variant: Ident::new(&camel_case(&name.to_string()), name.span()),
            is_async: signature.asyncness.is_some(),
            name,
            receiver,
            arguments,
            received: prev,
            feedback: progress,
            registrations,
            returns,
        };
        method.check_names()?;
        method.check_action()?;
        Ok(method)
    }

    pub(crate) fn registers(&self) -> impl Iterator<Item = &Register> {
        self.registrations.iter().flat_map(Registration::registers)
    }

    pub(crate) fn is_action(&self) -> bool {
        self.registers().any(|register| register.is_action)
    }

    /// True for an argument that a request carries: those of an action are its goal, without what `$` names.
    pub(crate) fn is_sent(&self, index: usize, argument: &Argument) -> bool {
        !self.is_action() || !self.is_substituted(index, argument)
    }

    fn is_substituted(&self, index: usize, argument: &Argument) -> bool {
        self.registers().flat_map(Register::texts).any(|text| {
            let text = text.value();
            let wanted = text.strip_prefix('$');
            wanted.is_some_and(|wanted| argument.name == wanted || wanted.parse() == Ok(index))
        })
    }

    /// The arguments that options name with `$`, by their place.
    pub(crate) fn substituted(&self) -> Vec<usize> {
        // A constant may turn out to be one of them: then all are kept.
        let is_constant = |text: &syn::Expr| !matches!(text, syn::Expr::Lit(_));
        let mut ends = self.registers().flat_map(|it| it.middleware.iter().chain([&it.topic]));
        let constant = ends.any(is_constant);
        let arguments = self.arguments.iter().enumerate();
        arguments
            .filter(|(index, argument)| constant || self.is_substituted(*index, argument))
            .map(|(index, _)| index)
            .collect()
    }

    /// An action has one result, nothing that it could receive, and feedback that goes through a borrow.
    fn check_action(&self) -> syn::Result<()> {
        let is_one = matches!(self.registrations.as_slice(), [Registration::One(_)]);
        match (self.is_action(), &self.received, &self.feedback) {
            (true, ..) if !is_one => wrong(
                self.name.span(),
                "an action is the only #[register] of its method, because a goal has one result",
            ),
            (true, Some((_, name, _)), _) => wrong(
                name.span(),
                "an action receives nothing beside its goal: leave #[received] out",
            ),
            (false, _, Some((_, name, _))) => wrong(
                name.span(),
                "only an action has feedback: write #[register(Action, …)] on the method",
            ),
            (_, _, Some((_, name, written))) if !matches!(written, Type::Reference(_)) => {
                wrong(name.span(), format!("feedback is lent: write `{name}: &Feedback`"))
            }
            _ => Ok(()),
        }
    }

    /// Every `$name` must be an argument.
    fn check_names(&self) -> syn::Result<()> {
        let names: Vec<_> =
            self.arguments.iter().map(|argument| argument.name.to_string()).collect();
        for register in self.registers() {
            for text in register.texts() {
                let value = text.value();
                let Some(wanted) = value.strip_prefix('$') else { continue };
                let number = wanted.parse::<usize>().ok();
                if number.is_some_and(|number| number < names.len())
                    || names.iter().any(|name| name == wanted)
                {
                    continue;
                }
                let has = match names.as_slice() {
                    [] => format!("`{}` has no arguments", self.name),
                    _ => format!(
                        "arguments of `{}` are {}, or $0 to ${}",
                        self.name,
                        listed(names.iter().map(String::as_str)),
                        names.len() - 1
                    ),
                };
                let hint = did_you_mean(wanted, names.iter().map(String::as_str));
                return wrong(text.span(), format!("`{value}` names no argument; {hint}{has}"));
            }
        }
        Ok(())
    }
}

/// The value in `#[default(value)]`.
fn default_value(attribute: &Attribute) -> syn::Result<syn::Expr> {
    attribute.parse_args().map_err(|_error| {
        let advice =
            "say what a client's call that leaves the argument out means: #[default(true)]";
        syn::Error::new(attribute.span(), advice)
    })
}

fn refuse_generics(method: &ImplItemFn) -> syn::Result<()> {
    let signature = &method.sig;
    if let Some(parameter) = signature.generics.params.first() {
        let advice = match parameter {
            GenericParam::Lifetime(_) => {
                "leave the lifetime out: `&str`, `&[T]` and `&T` need none"
            }
            _ => {
                "a registered method cannot be generic, because a server must know which type to decode: \
                  write one method for each type, or take a `Value`"
            }
        };
        return wrong(parameter.span(), advice);
    }
    if let Some(unsafety) = &signature.unsafety {
        return wrong(
            unsafety.span(),
            "a registered method is called for others: it cannot be unsafe",
        );
    }
    if let Some(abi) = &signature.abi {
        return wrong(
            abi.span(),
            "a registered method is an ordinary Rust method, without `extern`",
        );
    }
    Ok(())
}

fn receiver(signature: &syn::Signature) -> syn::Result<TokenStream> {
    match signature.inputs.first() {
        Some(FnArg::Receiver(receiver)) if receiver.colon_token.is_none() => {
            if receiver.reference.is_none() {
                let advice =
                    "a registered method is called again and again: take `&self` or `&mut self`";
                return wrong(receiver.span(), advice);
            }
            Ok(if receiver.mutability.is_some() { quote!(&mut self) } else { quote!(&self) })
        }
        Some(FnArg::Receiver(receiver)) => {
            wrong(receiver.span(), "write `&self` or `&mut self` here")
        }
        _ => wrong(
            signature.ident.span(),
            "a registered method belongs to an instance: take `&self` or `&mut self`",
        ),
    }
}

fn argument_name(pattern: &Pat) -> syn::Result<Ident> {
    match pattern {
        Pat::Ident(ident) if ident.by_ref.is_none() && ident.subpat.is_none() => {
            Ok(ident.ident.clone())
        }
        _ => wrong(
            pattern.span(),
            "an argument of a registered method has a name, which travels with a request: write `name: Type` \
             and take it apart inside",
        ),
    }
}

fn passing(written: &Type) -> syn::Result<Passing> {
    let Type::Reference(reference) = written else {
        refuse_parts(written)?;
        return Ok(Passing::Owned(written.clone()));
    };
    if reference.mutability.is_some() {
        let advice = "a server cannot give changes back through `&mut`: take it by value and return what changed";
        return wrong(written.span(), advice);
    }
    if let Some(lifetime) = &reference.lifetime {
        return wrong(lifetime.span(), "leave the lifetime out");
    }
    match &*reference.elem {
        Type::Slice(slice) => {
            refuse_parts(&slice.elem)?;
            Ok(Passing::Slice((*slice.elem).clone()))
        }
        Type::Path(path) if path.qself.is_none() && path.path.is_ident("str") => Ok(Passing::Text),
        inner => {
            refuse_parts(inner)?;
            Ok(Passing::Lent(inner.clone()))
        }
    }
}

/// Refuses a type that has a part which nothing can be decoded into, such as a borrow.
fn refuse_parts(kind: &Type) -> syn::Result<()> {
    fn walk(tokens: TokenStream) -> Result<(), (Span, &'static str)> {
        for token in tokens {
            let found = match &token {
                TokenTree::Ident(word) if word == "impl" => Some(
                    "`impl Trait` has no name that a server could decode: write the type itself",
                ),
                TokenTree::Ident(word) if word == "dyn" => {
                    Some("`dyn Trait` cannot be sent: write the type itself, or take a `Value`")
                }
                TokenTree::Punct(mark) if mark.as_char() == '&' => Some(
                    "a reference inside a type cannot be decoded: write `&str`, `&[T]` or `&T` as the whole \
                          type, or own it (`String`, `Vec<T>`, `Option<String>`)",
                ),
                TokenTree::Punct(mark) if mark.as_char() == '\'' => {
                    Some("a type with a lifetime cannot be decoded: take an owned one")
                }
                TokenTree::Group(group) => {
                    walk(group.stream())?;
                    None
                }
                _ => None,
            };
            if let Some(advice) = found {
                return Err((token.span(), advice));
            }
        }
        Ok(())
    }
    walk(kind.to_token_stream()).map_err(|(span, advice)| syn::Error::new(span, advice))
}

fn returns(output: &ReturnType, registrations: &[Registration]) -> syn::Result<Vec<Type>> {
    let whole = match output {
        ReturnType::Default => syn::parse_quote!(()),
        ReturnType::Type(_, whole) => (**whole).clone(),
    };
    let owned = |kind: &Type| {
        refuse_parts(kind).map_err(|_error| {
            let advice = "what a registered method returns may come from another program: return an owned type \
                          that has a name";
            syn::Error::new(kind.span(), advice)
        })
    };
    owned(&whole)?;
    let members = |kind: &Type, count: usize, what: &str| -> syn::Result<Vec<Type>> {
        match kind {
            Type::Tuple(tuple) if tuple.elems.len() == count => {
                Ok(tuple.elems.iter().cloned().collect())
            }
            Type::Tuple(tuple) => wrong(
                kind.span(),
                format!("{what}: a tuple of {count} should be here, not of {}", tuple.elems.len()),
            ),
            _ => wrong(
                kind.span(),
                format!("{what}: write the return type as a tuple of {count}, one for each"),
            ),
        }
    };
    let parts = match registrations {
        [_] => vec![whole],
        several => {
            let what = format!("this method has {} #[register]", several.len());
            members(&whole, several.len(), &what)?
        }
    };
    let mut returns = Vec::new();
    for (registration, part) in registrations.iter().zip(parts) {
        match registration {
            Registration::One(_) => returns.push(part),
            Registration::List(list) => {
                let what = format!("this #[register] lists {} members", list.len());
                returns.extend(members(&part, list.len(), &what)?);
            }
        }
    }
    Ok(returns)
}

fn camel_case(name: &str) -> String {
    name.trim_start_matches("r#")
        .split('_')
        .flat_map(|word| {
            let mut letters = word.chars();
            letters.next().map(|first| first.to_ascii_uppercase()).into_iter().chain(letters)
        })
        .collect()
}

/// `tokens` with `Self` written out: the wrapper stands in another impl block.
pub(crate) fn without_self(tokens: TokenStream, this: &Type) -> TokenStream {
    tokens
        .into_iter()
        .flat_map(|token| match token {
            TokenTree::Ident(word) if word == "Self" => quote!(#this),
            TokenTree::Group(group) => {
                let mut inside =
                    proc_macro2::Group::new(group.delimiter(), without_self(group.stream(), this));
                inside.set_span(group.span());
                TokenTree::Group(inside).into_token_stream()
            }
            other => other.into_token_stream(),
        })
        .collect()
}

/// A name for generated code that no argument can have.
pub(crate) fn hidden(name: &str) -> Ident {
    format_ident!("{name}", span = Span::mixed_site())
}
