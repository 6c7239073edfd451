//! Services that a node offers beside its own, from a table of names and types.

/// Makes an enum of services: each with its name behind that of the node, and its type.
macro_rules! node_services {
    ($(#[$doc:meta])* $services:ident { $($service:ident: $type:ident = $name:literal,)* }) => {
        wrapyfi_interfaces::named! {
            $(#[$doc])*
            pub enum $services {
                $(
                    #[doc = concat!("`~/", $name, "`")]
                    $service => $name,
                )*
            }
            /// Name behind that of the node.
            pub fn name;
        }

        impl $services {
            /// ROS name of the service's type.
            pub fn type_name(self) -> &'static str {
                match self {
                    $(Self::$service => $type::ROS_TYPE,)*
                }
            }

            /// Type hashes of the service.
            pub fn hashes(self) -> ServiceHashes {
                match self {
                    $(Self::$service => ServiceHashes::of::<$type>(),)*
                }
            }
        }
    };
}
