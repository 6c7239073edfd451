//! The code that `#[communicator]` adds.
//!
//! ```text
//!   enum CameraMethod              names, registers: a constant table that the library reads
//!   struct CameraCommunicator      { inner: Camera, instance }
//!     fn read(&self, …)            one for each registered method: see wrapper
//! ```

use proc_macro2::TokenStream;
use quote::{ToTokens as _, format_ident, quote};
use syn::ext::IdentExt as _;

use crate::block::Block;
use crate::method::{Method, without_self};
use crate::wrapper::Wrapper;

/// Methods that every communicator has.
pub(crate) const TAKEN: [&str; 9] = [
    "activate",
    "close",
    "close_method",
    "control",
    "inner",
    "inner_mut",
    "into_inner",
    "mode",
    "status",
];

/// Code that is added after the block.
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
    let described = methods.iter().map(|method| describe(method, this, &api));
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
                self.communicator_in(&#api::CommunicatorContext::global())
            }

            /// The same in a context of its own.
            #visibility fn communicator_in(self, context: &#api::CommunicatorContext) -> #communicator {
                #communicator { inner: self, instance: #api::Instance::new(context) }
            }
        }

        #allow
        #[automatically_derived]
        impl #communicator {
            /// Chooses the mode of a method, given by value or by name: a mode, its name, or a list
            /// by instance, of which this instance takes its own.
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

            /// Connections of each returned value of a method, with their counters.
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
fn describe(method: &Method, this: &syn::Type, api: &TokenStream) -> TokenStream {
    let name = method.name.unraw().to_string();
    let arguments = method.arguments.iter().map(|argument| argument.name.unraw().to_string());
    let registers = method.registers().zip(&method.returns).map(|(register, returned)| {
        register.constant(api, &without_self(returned.to_token_stream(), this))
    });
    let (receives, is_action) = (method.received.is_some(), method.is_action());
    let has_feedback = method.feedback.is_some();
    quote! {
        #api::MethodSpec {
            name: #name,
            arguments: &[#(#arguments),*],
            registers: &[#(#registers),*],
            receives: #receives,
            is_action: #is_action,
            has_feedback: #has_feedback,
        }
    }
}
