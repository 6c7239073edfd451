//! Errors of serialised messages.

/// Error of decoding a serialised message. `path` is the field, for instance
/// `node_entities_info_seq[2].node_name`.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CdrError {
    /// The message is larger than the caller allows.
    #[error("message of {actual} bytes is over the limit of {limit} bytes")]
    TooLarge {
        /// Size in bytes.
        actual: usize,
        /// Limit in bytes.
        limit: usize,
    },
    /// The first bytes announce something other than plain CDR.
    #[error(
        "encapsulation {0:02x?} is not plain CDR (00 00 or 00 01): the sender must offer the \
         XCDR1 data representation"
    )]
    Encapsulation(Vec<u8>),
    /// The message ends inside a field.
    #[error("{path} needs {needed} bytes, {available} are left: truncated, or of another type")]
    Truncated {
        /// The field.
        path: String,
        /// Bytes it needs.
        needed: usize,
        /// Bytes that are left.
        available: usize,
    },
    /// More bytes follow the last field than padding accounts for.
    #[error("{0} bytes are left behind the last field: it is of another type")]
    Trailing(usize),
    /// A sequence or a string claims more elements than the message has room for.
    #[error(
        "{path} claims {claimed} elements, which need {needed} bytes, {available} are left: {}",
        guess(*claimed, *needed)
    )]
    Length {
        /// The field.
        path: String,
        /// Elements claimed; bytes with the terminator for a string.
        claimed: u64,
        /// Least number of bytes they take.
        needed: u64,
        /// Bytes that are left.
        available: usize,
    },
    /// The last byte of a string is not NUL.
    #[error("{path} is a string of {length} bytes that ends with {last:#04x} instead of NUL")]
    Unterminated {
        /// The field.
        path: String,
        /// Length claimed, with the terminator.
        length: usize,
        /// The byte where NUL should be.
        last: u8,
    },
}

impl CdrError {
    /// The same error, seen from the message that has the value in its field `name`.
    #[must_use]
    pub fn in_field(mut self, name: &str) -> Self {
        self.change_path(|path| path_in_field(path, name));
        self
    }

    /// The same error, seen from the sequence that has the value at `index`.
    #[must_use]
    pub fn in_element(mut self, index: usize) -> Self {
        self.change_path(|path| path_in_element(path, index));
        self
    }

    /// The field it lies in; empty for the message as a whole.
    pub fn path(&self) -> &str {
        match self {
            Self::TooLarge { .. } | Self::Encapsulation(_) | Self::Trailing(_) => "",
            Self::Truncated { path, .. }
            | Self::Length { path, .. }
            | Self::Unterminated { path, .. } => path,
        }
    }

    /// Changes the path of an error that lies in a field.
    pub(crate) fn change_path(&mut self, change: impl FnOnce(&String) -> String) {
        match self {
            Self::TooLarge { .. } | Self::Encapsulation(_) | Self::Trailing(_) => {}
            Self::Truncated { path, .. }
            | Self::Length { path, .. }
            | Self::Unterminated { path, .. } => *path = change(path),
        }
    }
}

/// Reason why a sequence claims so many elements: the largest number of bytes stands in ROS 2 Lyrical for a description of
/// memory that only nodes of one machine and maker can read.
fn guess(claimed: u64, needed: u64) -> &'static str {
    if claimed == u64::from(u32::MAX) && needed == claimed {
        "a buffer in the memory of a device (rosidl::Buffer), or corrupt; its values are on the topic without /_buf"
    } else {
        "corrupt, or of another type"
    }
}

/// `inner` of the field `name`: `name.inner`, `name[3]`.
pub(crate) fn path_in_field(inner: &str, name: &str) -> String {
    match inner {
        "" => name.to_owned(),
        inner if inner.starts_with('[') => format!("{name}{inner}"),
        inner => format!("{name}.{inner}"),
    }
}

/// `inner` of the element at `index`: `[3].inner`.
pub(crate) fn path_in_element(inner: &str, index: usize) -> String {
    match inner {
        "" => format!("[{index}]"),
        inner => format!("[{index}].{inner}"),
    }
}
