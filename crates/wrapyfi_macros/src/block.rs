//! The impl block under `#[communicator]`, and everything found in it.

use proc_macro2::TokenStream;
use quote::{ToTokens as _, quote};
use syn::parse::{ParseStream, Parser as _};
use syn::spanned::Spanned as _;
use syn::{Ident, ImplItem, ItemImpl, Type, Visibility};

use crate::emit;
use crate::method::{self, Method};

/// The block, its type and its registered methods.
pub(crate) struct Block {
    pub(crate) this: Type,
    /// Last part of the type's name.
    pub(crate) name: Ident,
    /// Of everything that is added.
    pub(crate) visibility: Visibility,
    /// `::wrapyfi_core`, or what the attribute says.
    pub(crate) krate: TokenStream,
    pub(crate) methods: Vec<Method>,
}

/// The crate that the brackets of `#[communicator(…)]` name.
fn named_crate(input: ParseStream<'_>) -> syn::Result<Option<syn::Path>> {
    if input.is_empty() {
        return Ok(None);
    }
    if !input.peek(syn::Token![crate]) {
        return Err(input.error(
            "#[communicator] takes nothing, or crate = path; topics and types stand in #[register] on \
             the methods",
        ));
    }
    input.parse::<syn::Token![crate]>()?;
    input.parse::<syn::Token![=]>()?;
    input.parse().map(Some)
}

/// The block without our marks, and what is added to it; or the block and every mistake in it.
pub(crate) fn expand(attribute: TokenStream, item: &TokenStream) -> TokenStream {
    let mut block = match syn::parse2::<ItemImpl>(item.clone()) {
        Ok(block) => block,
        Err(_no_impl) => {
            let advice =
                "#[communicator] stands on an impl block: #[communicator] impl Camera { … }";
            let error = syn::Error::new(proc_macro2::Span::call_site(), advice).to_compile_error();
            return quote!(#error #item);
        }
    };
    match analyse(attribute, &mut block) {
        Ok(found) => {
            let added = emit::emit(&found);
            quote!(#block #added)
        }
        Err(errors) => {
            let errors = errors.to_compile_error();
            quote!(#block #errors)
        }
    }
}

fn analyse(attribute: TokenStream, block: &mut ItemImpl) -> syn::Result<Block> {
    let mut errors = Vec::<syn::Error>::new();
    let mut methods = Vec::new();
    // All methods first: the marks must be gone whatever else is wrong.
    for item in &mut block.items {
        if let ImplItem::Fn(function) = item {
            match method::analyse(function) {
                None => {}
                Some(Ok(found)) => methods.push(found),
                Some(Err(error)) => errors.push(error),
            }
        }
    }
    let krate = named_crate.parse2(attribute);
    if let Some((_, path, _)) = &block.trait_ {
        errors.push(syn::Error::new(
            path.span(),
            "#[communicator] stands on the type's own impl block: move the registered methods there",
        ));
    }
    if let Some(parameter) = block.generics.params.first() {
        errors.push(syn::Error::new(
            parameter.span(),
            "a communicator cannot be generic, because topics and types are fixed: write a struct without \
             parameters around it",
        ));
    }
    let name = match &*block.self_ty {
        Type::Path(path) if path.qself.is_none() => {
            path.path.segments.last().map(|last| last.ident.clone())
        }
        _ => None,
    };
    let nameless = "a communicator is made of a struct or an enum";
    let name = name.ok_or_else(|| syn::Error::new(block.self_ty.span(), nameless));
    errors.extend(name.as_ref().err().cloned());
    if methods.is_empty() && errors.is_empty() {
        errors.push(syn::Error::new(
            block.self_ty.span(),
            "no method has #[register]: write #[register(NativeObject, \"zeromq\", \"/topic\")] on one",
        ));
    }
    for (index, found) in methods.iter().enumerate() {
        if emit::TAKEN.contains(&found.name.to_string().as_str()) {
            let text = format!(
                "the communicator has a method `{}` of its own: choose another name",
                found.name
            );
            errors.push(syn::Error::new(found.name.span(), text));
        }
        if methods.iter().take(index).any(|earlier| earlier.variant == found.variant) {
            let text =
                format!("`{}` of the methods' enum is taken: choose another name", found.variant);
            errors.push(syn::Error::new(found.name.span(), text));
        }
    }
    errors.extend(krate.as_ref().err().cloned());
    let all = errors.into_iter().reduce(|mut all, next| {
        all.combine(next);
        all
    });
    if let Some(all) = all {
        return Err(all);
    }
    Ok(Block {
        this: (*block.self_ty).clone(),
        name: name?,
        visibility: widest(&methods),
        krate: krate?.map_or_else(|| quote!(::wrapyfi_core), |path| path.to_token_stream()),
        methods,
    })
}

/// The most visible of the methods' visibilities.
fn widest(methods: &[Method]) -> Visibility {
    let rank = |visibility: &Visibility| match visibility {
        Visibility::Public(_) => 3,
        Visibility::Restricted(restricted) if restricted.path.is_ident("crate") => 2,
        Visibility::Restricted(_) => 1,
        Visibility::Inherited => 0,
    };
    methods
        .iter()
        .map(|method| &method.visibility)
        .max_by_key(|visibility| rank(visibility))
        .cloned()
        .unwrap_or(Visibility::Inherited)
}
