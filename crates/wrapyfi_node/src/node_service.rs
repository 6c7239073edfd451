//! Services that a node offers beside its own, from a table of names and types.

/// Makes an enum of services: each with its name behind that of the node, and its type.
macro_rules! node_services {
    ($(#[$doc:meta])* $services:ident { $($service:ident: $type:ident = $name:literal,)* }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        pub enum $services {
            $(
                #[doc = concat!("`~/", $name, "`")]
                $service,
            )*
        }

        impl $services {
            /// All of them, in the order in which nodes offer them.
            pub const ALL: [Self; [$($name),*].len()] = [$(Self::$service),*];

            /// Name behind that of the node.
            #[must_use]
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$service => $name,)*
                }
            }

            /// ROS name of the service's type.
            #[must_use]
            pub fn type_name(self) -> &'static str {
                match self {
                    $(Self::$service => $type::ROS_TYPE,)*
                }
            }

            /// Type hashes of the service.
            #[must_use]
            pub fn hashes(self) -> ServiceHashes {
                match self {
                    $(Self::$service => ServiceHashes::of::<$type>(),)*
                }
            }
        }
    };
}
