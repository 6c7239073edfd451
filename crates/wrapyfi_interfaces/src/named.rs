//! Enums whose variants have a name each.

/// Makes an enum of a table: its variants, each beside its name, the method that gives the name, and,
/// where a second one is named, the function that finds the variant of a name.
///
/// ```
/// wrapyfi_interfaces::named! {
///     /// Colour of a light.
///     pub enum Light { Red => "red", Green => "green" }
///     /// Name in configurations.
///     pub fn name, from_name;
/// }
/// assert_eq!(Light::ALL.map(Light::name), ["red", "green"]);
/// assert_eq!(Light::Red.to_string(), "red");
/// assert_eq!(Light::from_name("green"), Some(Light::Green));
/// ```
#[macro_export]
macro_rules! named {
    (
        $(#[$head:meta])*
        $visibility:vis enum $enum:ident {
            $($(#[$doc:meta])* $variant:ident $(= $number:literal)? => $name:literal),* $(,)?
        }
        $(#[$method_doc:meta])*
        pub fn $method:ident $(, $from:ident)?;
    ) => {
        $(#[$head])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        $visibility enum $enum {
            $($(#[$doc])* $variant $(= $number)?,)*
        }

        impl $enum {
            /// All of them, in order.
            pub const ALL: [Self; [$($name),*].len()] = [$(Self::$variant),*];

            $(#[$method_doc])*
            #[must_use]
            pub const fn $method(self) -> &'static str {
                match self {
                    $(Self::$variant => $name,)*
                }
            }

            $(
                /// Variant with this name.
                #[must_use]
                pub fn $from(name: &str) -> Option<Self> {
                    Self::ALL.into_iter().find(|one| one.$method() == name)
                }
            )?
        }

        impl std::fmt::Display for $enum {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str(self.$method())
            }
        }
    };
}
