//! The code that `#[communicator]` adds.
//!
//! ```text
//!   enum CameraMethod              names, registers: a constant table that the library reads
//!   struct CameraCommunicator      { inner: Camera, instance }
//!     fn read(&self, …)            one wrapper for each registered method; what it does by mode:
//!
//!       none       body                              → own values
//!       disable                                      → nothing
//!       publish            wait ─ body ─ send        → own values
//!       listen     gather                            → received values
//!       receive    gather       ─ body               → own values
//!       reemit     gather ─ wait ─ body ─ send       → own values
//!       transceive         wait ─ body ─ send ─ gather → received values
//!       request    ask                               → replies
//!       reply      hear ─ body with the request's arguments ─ answer → own values
//! ```

use proc_macro2::{Ident, TokenStream};
use quote::{ToTokens, format_ident, quote};
use syn::ext::IdentExt as _;

use crate::block::Block;
use crate::method::{Argument, Method, Passing, hidden, without_self};
use crate::register::Registration;

/// Methods that every communicator has.
pub(crate) const TAKEN: [&str; 10] = [
    "activate",
    "close",
    "close_method",
    "context",
    "control",
    "inner",
    "inner_mut",
    "into_inner",
    "mode",
    "status",
];

/// What is added after the block.
pub(crate) fn emit(block: &Block) -> TokenStream {
    let Block { this, name, visibility, krate, methods } = block;
    let api = quote!(#krate::communicator);
    let text = name.unraw().to_string();
    let method_type = format_ident!("{name}Method");
    let communicator = format_ident!("{name}Communicator");
    let variants = methods.iter().map(|method| {
        let (variant, doc) = (&method.variant, format!("`{text}::{}`.", method.name));
        quote!(#[doc = #doc] #variant)
    });
    let all = methods.iter().map(|method| &method.variant);
    let described = methods.iter().map(|method| describe(method, &api));
    let wrappers = methods
        .iter()
        .enumerate()
        .map(|(index, method)| Wrapper { block, method, api: &api, index }.emit());
    let method_doc = format!("The registered methods of `{text}`.");
    let communicator_doc =
        format!("A `{text}` with registered methods whose role is chosen at run time.");
    let allow = quote! {
        #[allow(dead_code, unused_qualifications, unreachable_pub, private_interfaces, unused_mut, unused_assignments, clippy::all, clippy::pedantic)]
    };
    quote! {
        #[doc = #method_doc]
        #allow
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        #visibility enum #method_type { #(#variants),* }

        #[automatically_derived]
        impl #api::Method for #method_type {
            const CLASS: &'static #api::Class =
                &#api::Class { name: #text, methods: &[#(#described),*] };
            const ALL: &'static [Self] = &[#(Self::#all),*];

            fn index(self) -> usize {
                self as usize
            }
        }

        #[doc = #communicator_doc]
        #allow
        #visibility struct #communicator {
            inner: #this,
            instance: #api::Instance<#method_type>,
        }

        #allow
        #[automatically_derived]
        impl #this {
            /// This instance with registered methods, all in mode `none` until they are activated or
            /// the configuration says otherwise, in the context of the process.
            #visibility fn communicator(self) -> #communicator {
                self.communicator_in(&#api::Context::global())
            }

            /// The same in a context of its own.
            #visibility fn communicator_in(self, context: &#api::Context) -> #communicator {
                #communicator { inner: self, instance: #api::Instance::new(context) }
            }
        }

        #allow
        #[automatically_derived]
        impl #communicator {
            /// Chooses the mode of a method, given by value or by name: one for this instance, or a
            /// list of which this instance takes its own.
            ///
            /// # Errors
            /// When name or mode are unknown, the list is too short for this instance, or the method
            /// lacks what the mode needs.
            #visibility fn activate(
                &mut self,
                method: impl #api::NamesMethod<#method_type>,
                mode: impl #api::NamesMode,
            ) -> ::core::result::Result<(), #api::ActivateError> {
                self.instance.activate(method, mode)
            }

            /// The mode of a method now.
            #visibility fn mode(&self, method: #method_type) -> #api::Mode {
                self.instance.mode(method)
            }

            /// Closes every method's endpoints; the next call opens them anew, with its arguments.
            #visibility fn close(&mut self) {
                self.instance.close();
            }

            /// Closes one method's endpoints.
            #visibility fn close_method(&mut self, method: #method_type) {
                self.instance.close_method(method);
            }

            /// What each returned value of a method is connected to, with its counters.
            #visibility fn status(&self, method: #method_type) -> ::std::vec::Vec<#api::ValueStatus> {
                self.instance.status(method)
            }

            /// Changes modes, closes and ends waits from any thread.
            #visibility fn control(&self) -> #api::Control<#method_type> {
                self.instance.control()
            }

            /// The wrapped instance.
            #visibility fn inner(&self) -> &#this {
                &self.inner
            }

            /// The wrapped instance.
            #visibility fn inner_mut(&mut self) -> &mut #this {
                &mut self.inner
            }

            /// Closes everything; the wrapped instance is left.
            #visibility fn into_inner(self) -> #this {
                self.inner
            }

            #(#wrappers)*
        }

        #[automatically_derived]
        impl ::core::fmt::Debug for #communicator {
            fn fmt(&self, f: &mut ::core::fmt::Formatter<'_>) -> ::core::fmt::Result {
                ::core::fmt::Debug::fmt(&self.instance, f)
            }
        }
    }
}

/// One method as a constant.
fn describe(method: &Method, api: &TokenStream) -> TokenStream {
    let name = method.name.unraw().to_string();
    let arguments = method.arguments.iter().map(|argument| argument.name.unraw().to_string());
    let registers = method.registrations.iter().flat_map(Registration::registers);
    let registers = registers.map(|register| register.constant(api));
    let receives = method.received.is_some();
    quote! {
        #api::MethodSpec {
            name: #name,
            arguments: &[#(#arguments),*],
            registers: &[#(#registers),*],
            receives: #receives,
        }
    }
}

struct Wrapper<'a> {
    block: &'a Block,
    method: &'a Method,
    api: &'a TokenStream,
    index: usize,
}

impl Wrapper<'_> {
    fn emit(&self) -> TokenStream {
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
        if let Some((place, name, written)) = &method.received {
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
        let wait = |step: TokenStream, step_async: TokenStream| {
            if *is_async { quote!(#session.#step_async.await?) } else { quote!(#session.#step?) }
        };
        let opened = if *is_async {
            quote!(#call.open_async(#substituted).await?)
        } else {
            quote!(#call.open(#substituted)?)
        };
        let gather = wait(quote!(gather()), quote!(gather_async()));
        let await_listeners = wait(quote!(await_listeners()), quote!(await_listeners_async()));
        let sends = (0..method.returns.len()).map(|index| {
            let (kind, value) = (self.kind(index), self.value(index));
            if *is_async {
                quote!(#session.send_async::<#api::#kind, _>(#index, &#value).await?;)
            } else {
                quote!(#session.send::<#api::#kind, _>(#index, &#value)?;)
            }
        });
        let fed = method.received.as_ref().map(|(_, name, written)| {
            let written = without_self(written.to_token_stream(), this);
            quote! {
                let #name: #written = if #mode.feeds_body() { #taken } else { #name };
            }
        });
        let request = self.request(&session, &gathered, &taken);
        let reply = self.reply(&session, &own, &some, &nothing);
        let from = format!("What `{}::{name}` does in the mode that is active.", block.name);
        quote! {
            #(#docs)*
            #[doc = ""]
            #[doc = #from]
            #[doc = ""]
            #[doc = "# Errors"]
            #[doc = "When an endpoint cannot be opened, a value has no form on its wire, a wait is ended or nobody replies."]
            #visibility #asyncness fn #name(#receiver, #(#inputs),*)
                -> ::core::result::Result<#output, #api::CallError>
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
                let mut #gathered = #api::Gathered::default();
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
                    #(#sends)*
                }
                if #mode == #api::Mode::Transceive {
                    #gathered = #gather;
                    return ::core::result::Result::Ok(#taken);
                }
                ::core::result::Result::Ok(#some)
            }
        }
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
        let mut registers = self.method.registrations.iter().flat_map(Registration::registers);
        let data_type = registers.nth(index).map(|register| &register.data_type);
        quote!(kind::#data_type)
    }

    /// A call of the body: with the arguments of the wrapper, or with twins of these names.
    fn body(&self, twins: Option<&[Ident]>) -> TokenStream {
        let mut arguments: Vec<TokenStream> = self
            .method
            .arguments
            .iter()
            .enumerate()
            .map(|(index, Argument { name, passing, .. })| {
                match twins.and_then(|twins| twins.get(index)) {
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
        let pairs = self.method.arguments.iter().map(|argument| {
            let (name, value) = (argument.name.unraw().to_string(), Self::lent(argument));
            quote!((#name, #api::argument(#value)))
        });
        let pairs = quote!(::std::vec![#(#pairs),*]);
        let ask = if self.method.is_async {
            quote!(#session.ask_async(#pairs).await?)
        } else {
            quote!(#session.ask(#pairs)?)
        };
        quote! {
            let mut #gathered = #ask;
            return ::core::result::Result::Ok(#taken);
        }
    }

    fn reply(
        &self,
        session: &Ident,
        own: &TokenStream,
        some: &TokenStream,
        nothing: &TokenStream,
    ) -> TokenStream {
        let (api, this, method) = (self.api, &self.block.this, self.method);
        let request = hidden("request");
        let twins: Vec<_> =
            (0..method.arguments.len()).map(|index| hidden(&format!("twin_{index}"))).collect();
        let decoded =
            method.arguments.iter().zip(&twins).enumerate().map(|(index, (argument, twin))| {
                let name = argument.name.unraw().to_string();
                let kind = match &argument.passing {
                    Passing::Owned(kind) | Passing::Lent(kind) => kind.to_token_stream(),
                    Passing::Text => quote!(::std::string::String),
                    Passing::Slice(element) => quote!(::std::vec::Vec<#element>),
                };
                let kind = without_self(kind, this);
                quote! {
                    let #twin: #kind = match #request.argument(#index, #name) {
                        ::core::result::Result::Ok(twin) => twin,
                        ::core::result::Result::Err(reason) => {
                            #request.refuse(&reason);
                            continue;
                        }
                    };
                }
            });
        let body = self.body(Some(&twins));
        let answers = (0..method.returns.len()).map(|index| {
            let (kind, value) = (self.kind(index), self.value(index));
            if method.is_async {
                quote!(#session.answer_async::<#api::#kind, _>(&mut #request, #index, &#value).await?;)
            } else {
                quote!(#session.answer::<#api::#kind, _>(&mut #request, #index, &#value)?;)
            }
        });
        let hear = if method.is_async {
            quote!(#session.hear_async().await?)
        } else {
            quote!(#session.hear()?)
        };
        quote! {
            let (mut #request, #(#twins),*) = loop {
                let ::core::option::Option::Some(mut #request) = #hear else {
                    return ::core::result::Result::Ok(#nothing);
                };
                #(#decoded)*
                break (#request, #(#twins),*);
            };
            let #own = #body;
            #(#answers)*
            return ::core::result::Result::Ok(#some);
        }
    }
}
