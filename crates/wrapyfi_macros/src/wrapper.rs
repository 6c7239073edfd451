//! One registered method of the communicator: what it does, by mode.
//!
//! ```text
//!   none       body                              → own values
//!   disable                                      → nothing
//!   publish            wait ─ body ─ send        → own values
//!   listen     gather                            → received values
//!   receive    gather       ─ body               → own values
//!   reemit     gather ─ wait ─ body ─ send       → own values
//!   transceive         wait ─ body ─ send ─ gather → received values
//!   request    ask                               → replies
//!   reply      hear ─ body with the request's arguments ─ answer → own values
//!
//! Request and reply of an action are its goal and its result.
//! ```

use proc_macro2::{Ident, TokenStream};
use quote::{ToTokens, quote};
use syn::ext::IdentExt as _;

use crate::block::Block;
use crate::method::{Argument, Method, Passing, hidden, without_self};
use crate::register::Registration;

/// A method of the communicator.
pub(crate) struct Wrapper<'a> {
    pub(crate) block: &'a Block,
    pub(crate) method: &'a Method,
    /// Path of `wrapyfi_core::communicator`.
    pub(crate) api: &'a TokenStream,
    /// Its place among the registered methods.
    pub(crate) index: usize,
}

impl Wrapper<'_> {
    pub(crate) fn emit(&self) -> TokenStream {
        let Self { block, method, api, index } = self;
        let Method { visibility, docs, name, receiver, is_async, .. } = method;
        let this = &block.this;
        let asyncness = is_async.then(|| quote!(async));
        let (call, session, mode) = (hidden("call"), hidden("session"), hidden("mode"));
        let gathered = hidden("gathered");

        let mut inputs: Vec<TokenStream> = method
            .arguments
            .iter()
            .map(|Argument { name, written, .. }| quote!(#name: #written))
            .collect();
        for (place, name, written) in method.received.iter().chain(&method.feedback) {
            inputs.insert(*place, quote!(#name: #written));
        }
        let inputs = inputs.into_iter().map(|input| without_self(input, this));
        let output = self.nest(|index| {
            let kind = method.returns.get(index).map(ToTokens::to_token_stream).unwrap_or_default();
            let kind = without_self(kind, this);
            quote!(::core::option::Option<#kind>)
        });

        let own = self.nest(|index| self.value(index).into_token_stream());
        let some = self.nest(|index| {
            let value = self.value(index);
            quote!(::core::option::Option::Some(#value))
        });
        let nothing = self.nest(|_| quote!(::core::option::Option::None));
        let taken = self.nest(|index| {
            let (kind, register) = (self.kind(index), index);
            quote!(#session.taken::<#api::#kind, _>(&mut #gathered, #register)?)
        });
        let body = self.body(None);
        let substituted = self.opening();
        let opened = self.waited(&quote!(#call.open(#is_async, #substituted)));
        let gather = self.waited(&quote!(#session.gather(#is_async)));
        let await_listeners = self.waited(&quote!(#session.await_listeners(#is_async)));
        let sends = (0..method.returns.len()).map(|index| {
            let (kind, value) = (self.kind(index), self.value(index));
            self.waited(&quote!(#session.send::<#api::#kind, _>(#is_async, #index, &#value)))
        });
        let fed = method.received.as_ref().map(|(_, name, written)| {
            let written = without_self(written.to_token_stream(), this);
            quote! {
                let #name: #written = if #mode.feeds_body() { #taken } else { #name };
            }
        });
        let request = self.request(&session, &gathered, &taken);
        let reply = self.reply(&own, &some, &nothing);
        let from = format!("What `{}::{name}` does in the mode that is active.", block.name);
        quote! {
            #(#docs)*
            #[doc = ""]
            #[doc = #from]
            #[doc = ""]
            #[doc = "# Errors"]
            #[doc = "When an endpoint cannot be opened, a value has no form on its wire, a wait is ended or nobody replies."]
            #visibility #asyncness fn #name(#receiver, #(#inputs),*)
                -> ::core::result::Result<#output, #api::MethodError>
            {
                let #call = self.instance.call(#index)?;
                let #mode = #call.mode();
                if #mode == #api::Mode::None {
                    let #own = #body;
                    return ::core::result::Result::Ok(#some);
                }
                if #mode == #api::Mode::Disable {
                    return ::core::result::Result::Ok(#nothing);
                }
                let #session = #opened;
                if #mode == #api::Mode::Request {
                    #request
                }
                if #mode == #api::Mode::Reply && #session.serves() {
                    #reply
                }
                let mut #gathered = #api::GatheredMessages::default();
                if #mode.listens_first() {
                    #gathered = #gather;
                    if #mode == #api::Mode::Listen {
                        return ::core::result::Result::Ok(#taken);
                    }
                }
                if #mode.sends() {
                    #await_listeners;
                }
                #fed
                let #own = #body;
                if #mode.sends() {
                    #(#sends;)*
                }
                if #mode == #api::Mode::Transceive {
                    #gathered = #gather;
                    return ::core::result::Result::Ok(#taken);
                }
                ::core::result::Result::Ok(#some)
            }
        }
    }

    /// The result of a step that may wait: as a task in an async method, else blocking the thread.
    fn waited(&self, step: &TokenStream) -> TokenStream {
        let api = self.api;
        if self.method.is_async { quote!(#step.await?) } else { quote!(#api::at_once(#step)?) }
    }

    /// The shape of the returned values, with `item` for each.
    fn nest(&self, item: impl Fn(usize) -> TokenStream) -> TokenStream {
        let mut next = 0;
        let mut one = || {
            next += 1;
            item(next - 1)
        };
        let parts: Vec<_> = self
            .method
            .registrations
            .iter()
            .map(|registration| match registration {
                Registration::One(_) => one(),
                Registration::List(members) => {
                    let members: Vec<_> = members.iter().map(|_| one()).collect();
                    quote!((#(#members,)*))
                }
            })
            .collect();
        match parts.as_slice() {
            [single] => single.clone(),
            several => quote!((#(#several,)*)),
        }
    }

    fn value(&self, index: usize) -> Ident {
        hidden(&format!("value_{index}"))
    }

    /// The marker of a value's data type.
    fn kind(&self, index: usize) -> TokenStream {
        let data_type = self.method.registers().nth(index).map(|register| &register.data_type);
        quote!(kind::#data_type)
    }

    /// A call of the body: with the arguments of the wrapper, or with twins of these names.
    fn body(&self, twins: Option<&[Option<Ident>]>) -> TokenStream {
        let mut arguments: Vec<TokenStream> = self
            .method
            .arguments
            .iter()
            .enumerate()
            .map(|(index, Argument { name, passing, .. })| {
                match twins.and_then(|twins| twins.get(index)?.as_ref()) {
                    None => name.to_token_stream(),
                    Some(twin) => match passing {
                        Passing::Owned(_) => quote!(#twin),
                        Passing::Text | Passing::Slice(_) | Passing::Lent(_) => quote!(&#twin),
                    },
                }
            })
            .collect();
        if let Some((place, name, _)) = &self.method.received {
            // What was received is nothing that a client sends.
            let argument = if twins.is_some() {
                quote!(::core::default::Default::default())
            } else {
                quote!(#name)
            };
            arguments.insert(*place, argument);
        }
        if let Some((place, name, _)) = &self.method.feedback {
            let feedback = hidden("feedback");
            let argument = if twins.is_some() { quote!(&#feedback) } else { quote!(#name) };
            arguments.insert(*place, argument);
        }
        let name = &self.method.name;
        let call = quote!(self.inner.#name(#(#arguments),*));
        if self.method.is_async { quote!(#call.await) } else { call }
    }

    /// The arguments that `$` may name, as a closure that is called at the first call only.
    fn opening(&self) -> TokenStream {
        let api = self.api;
        let substituted = self.method.substituted();
        let arguments = self.method.arguments.iter().enumerate();
        let used = arguments.filter(|(index, _)| substituted.contains(index));
        let pairs = used.map(|(index, argument)| {
            let value = Self::lent(argument);
            quote!((#index, #api::argument(#value)))
        });
        quote!(|| ::std::vec![#(#pairs),*])
    }

    /// A reference to what an argument holds.
    fn lent(Argument { name, passing, .. }: &Argument) -> TokenStream {
        match passing {
            Passing::Owned(_) => quote!(&#name),
            Passing::Text | Passing::Slice(_) | Passing::Lent(_) => quote!(#name),
        }
    }

    fn request(&self, session: &Ident, gathered: &Ident, taken: &TokenStream) -> TokenStream {
        let api = self.api;
        let sent = self.method.arguments.iter().enumerate();
        let sent = sent.filter(|(index, argument)| self.method.is_sent(*index, argument));
        let pairs = sent.map(|(_, argument)| {
            let (name, value) = (argument.name.unraw().to_string(), Self::lent(argument));
            quote!((#name, #api::argument(#value)))
        });
        let pairs = quote!(::std::vec![#(#pairs),*]);
        let is_async = self.method.is_async;
        let feedback = match &self.method.feedback {
            Some((_, name, _)) => quote!(::core::option::Option::Some(#name)),
            None => quote!(::core::option::Option::None),
        };
        let ask = self.waited(&quote!(#session.ask(#is_async, #pairs, #feedback)));
        quote! {
            let mut #gathered = #ask;
            return ::core::result::Result::Ok(#taken);
        }
    }

    fn reply(&self, own: &TokenStream, some: &TokenStream, nothing: &TokenStream) -> TokenStream {
        let (api, this, method) = (self.api, &self.block.this, self.method);
        let (session, request) = (hidden("session"), hidden("request"));
        let twin = |(index, argument)| {
            method.is_sent(index, argument).then(|| hidden(&format!("twin_{index}")))
        };
        let twins: Vec<_> = method.arguments.iter().enumerate().map(twin).collect();
        let decoded =
            method.arguments.iter().zip(&twins).enumerate().map(|(index, (argument, twin))| {
                let twin = twin.as_ref()?;
                let name = argument.name.unraw().to_string();
                let kind = match &argument.passing {
                    Passing::Owned(kind) | Passing::Lent(kind) => kind.to_token_stream(),
                    Passing::Text => quote!(::std::string::String),
                    Passing::Slice(element) => quote!(::std::vec::Vec<#element>),
                };
                let kind = without_self(kind, this);
                let found = match &argument.default {
                    None => quote!(#request.argument(#index, #name)),
                    Some(value) => {
                        let value = without_self(value.to_token_stream(), this);
                        let value = match &argument.passing {
                            Passing::Owned(_) | Passing::Lent(_) => value,
                            Passing::Text | Passing::Slice(_) => quote!(<#kind>::from(#value)),
                        };
                        quote!(#request.argument_or(#index, #name, || -> #kind { #value }))
                    }
                };
                Some(quote! {
                    let #twin: #kind = match #found {
                        ::core::result::Result::Ok(twin) => twin,
                        ::core::result::Result::Err(reason) => {
                            #request.refuse(&reason);
                            continue;
                        }
                    };
                })
            });
        let decoded = decoded.flatten();
        let body = self.body(Some(&twins));
        let twins: Vec<_> = twins.iter().flatten().collect();
        let feedback = method.feedback.as_ref().map(|_| {
            let feedback = hidden("feedback");
            quote!(let #feedback = #request.feedback();)
        });
        let is_async = method.is_async;
        let answers = (0..method.returns.len()).map(|index| {
            let (kind, value) = (self.kind(index), self.value(index));
            let answer = quote!(answer::<#api::#kind, _>);
            self.waited(&quote!(#session.#answer(#is_async, &mut #request, #index, &#value)))
        });
        let hear = self.waited(&quote!(#session.hear(#is_async)));
        quote! {
            let (mut #request, #(#twins),*) = loop {
                let ::core::option::Option::Some(mut #request) = #hear else {
                    return ::core::result::Result::Ok(#nothing);
                };
                #(#decoded)*
                break (#request, #(#twins),*);
            };
            #feedback
            let #own = #body;
            #(#answers;)*
            return ::core::result::Result::Ok(#some);
        }
    }
}
