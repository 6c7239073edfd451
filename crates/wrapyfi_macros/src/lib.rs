//! `#[communicator]` and `#[register]`: mark a method once, choose its role at run time.
//!
//! ```text
//!   #[communicator]                     register   what one #[register] says
//!   impl Camera { #[register(…)] fn … } options    the options that Wrapyfi knows, and their forms
//!        │                              method     receiver, arguments, returns of a marked method
//!        ▼                              block      the impl block and everything found in it
//!   impl Camera { fn … }  untouched     emit       the code that is added
//!   CameraMethod, CameraCommunicator    wrapper    one method of it
//! ```
//!
//! Use it through `wrapyfi_core::communicator`, whose documentation says what the added items do.

mod block;
mod emit;
mod method;
mod options;
mod register;
mod suggest;
mod wrapper;

use proc_macro::TokenStream;

/// Adds a communicator to a type: for `impl Camera` the types `CameraCommunicator` and
/// `CameraMethod`, and the methods `Camera::communicator` and `Camera::communicator_in`.
///
/// The impl block stays as it is; its methods with [`macro@register`] get a wrapper of the same
/// name on the communicator, which returns `Result<Option<R>, MethodError>`, or a tuple of `Option`s
/// where there are several. The wrappers are as visible as the most visible of these methods.
///
/// `#[communicator(crate = path)]` names the crate `wrapyfi_core` where it was renamed.
#[proc_macro_attribute]
pub fn communicator(attribute: TokenStream, item: TokenStream) -> TokenStream {
    block::expand(attribute.into(), &item.into()).into()
}

/// Data type of a returned value and the topic on which it travels: one for each returned value.
///
/// ```text
/// #[register(NativeObject, "zeromq", "/topic", should_wait = false, queue_size = 5)]
///            data type     middleware  topic    options
/// ```
///
/// The middleware may be left out (the default is used then), and a class name may stand before the
/// topic, as in Python. `"$name"` and `"$0"` are replaced by an argument of the first call. A method
/// that returns a list has one `#[register([…], […])]` with a bracket for each member.
///
/// `#[default(value)]` before an argument is what a server takes where a client leaves it out, as
/// `blocking=True` in Python's `def`.
///
/// The data type `Action` makes an action of the method: its arguments are the goal, without those that `$` names, and
/// what it returns is the result. `#[feedback]` marks an argument `&Feedback`.
///
/// ```text
/// #[register(Action, "ros2", "/count", action_type = "demo/action/Count")]
/// fn count(&self, to: i32, #[feedback] progress: &Feedback) -> i32
/// ```
///
/// It means something only inside a block that has [`macro@communicator`].
#[proc_macro_attribute]
pub fn register(_attribute: TokenStream, item: TokenStream) -> TokenStream {
    let advice = "write #[communicator] on the impl block of this method: #[register] marks methods \
                  inside such a block";
    let item = proc_macro2::TokenStream::from(item);
    let error = syn::Error::new(proc_macro2::Span::call_site(), advice).to_compile_error();
    quote::quote!(#error #item).into()
}
