//! Type supports for types that no package here defines.
//!
//! ```text
//!   "sensor_msgs/msg/Image", RIHS01_… ─▶ rosidl_message_type_support_t   kept as long as the process:
//!                                                                        middlewares keep pointers
//! ```

#![allow(unsafe_code, reason = "type supports are structs of C")]

use std::collections::HashMap;
use std::ffi::{CString, c_char};
use std::hash::Hash;
use std::ptr;
use std::sync::LazyLock;

use wrapyfi_interfaces::description::{
    CONTAINER_STEP, FieldDescription, MAX_DEPTH, TypeDescription,
};
use wrapyfi_retry::Mutex;

use super::Fault;
use super::sys;

/// REP-2016 hash of a type, version 1.
pub type TypeHash = [u8; 32];

/// A message type as middlewares are told of it.
#[derive(Debug, Clone, Copy)]
pub struct TypeInfo<'a> {
    /// ROS name, for instance `sensor_msgs/msg/Image`.
    pub name: &'a str,
    /// Its hash, where it is known.
    pub hash: Option<TypeHash>,
    /// Its fields, where they are known and the middleware is `rmw_cyclonedds_cpp`: from Kilted on its nodes compare them, and no
    /// other looks at them.
    pub description: Option<&'a TypeDescription>,
}

/// A pointer that every thread may read.
#[derive(Clone, Copy)]
pub(crate) struct SharedPointer<T>(pub(crate) *const T);

// SAFETY: what it points to is written before it is shared, never after, and is never freed.
unsafe impl<T> Send for SharedPointer<T> {}

pub(crate) type MessageType = SharedPointer<sys::rosidl_message_type_support_t>;
pub(crate) type ServiceType = SharedPointer<sys::rosidl_service_type_support_t>;

type Hashes = [Option<TypeHash>; 3];

/// Type supports, by name and hashes.
type Known<H, T> = LazyLock<Mutex<HashMap<(String, H), T>>>;

/// The hash, and whether the fields were known.
static MESSAGES: Known<(Option<TypeHash>, bool), MessageType> = LazyLock::new(Mutex::default);
static SERVICES: Known<Hashes, ServiceType> = LazyLock::new(Mutex::default);

/// `sensor_msgs/msg/Image` as `sensor_msgs::msg` and `Image`.
fn split(type_name: &str) -> Result<[CString; 2], Fault> {
    let wrong = || Fault::new("type support", format!("{type_name:?} is no package/kind/Type"));
    let (before, name) = type_name.rsplit_once('/').ok_or_else(wrong)?;
    if !before.contains('/') {
        return Err(wrong());
    }
    let text = |text: String| CString::new(text).ok().ok_or_else(wrong);
    Ok([text(before.replace('/', "::"))?, text(name.to_owned())?])
}

fn pointer(hash: Option<&TypeHash>) -> *const u8 {
    hash.map_or(ptr::null(), |hash| hash.as_ptr())
}

/// The type support that is known by this name and these hashes, else the one that `make` makes of package and name.
fn kept<H: Eq + Hash, T: Copy>(
    known: &Known<H, SharedPointer<T>>,
    (type_name, hashes): (&str, H),
    make: impl FnOnce(*const c_char, *const c_char) -> *const T,
) -> Result<SharedPointer<T>, Fault> {
    let [namespace, name] = split(type_name)?;
    let mut known = known.lock();
    let key = (type_name.to_owned(), hashes);
    if let Some(&made) = known.get(&key) {
        return Ok(made);
    }
    let made = make(namespace.as_ptr(), name.as_ptr());
    if made.is_null() {
        return Err(Fault::new("type support", "no memory"));
    }
    Ok(*known.entry(key).or_insert(SharedPointer(made)))
}

/// Type support of a message type.
pub(crate) fn message(of: &TypeInfo<'_>) -> Result<MessageType, Fault> {
    kept(&MESSAGES, (of.name, (of.hash, of.description.is_some())), |namespace, name| {
        let members = of.description.and_then(|all| {
            let mut nested = Nested { all, made: HashMap::new() };
            nested.members(&all.type_description.fields, 0)
        });
        let (members, _size) = members.unwrap_or_default();
        // SAFETY: the texts end with zeros and the hash has 32 bytes.
        unsafe { make(namespace, name, pointer(of.hash.as_ref()), &members) }
    })
}

/// A member, and the text that it points to.
struct Member {
    _name: CString,
    raw: sys::wrapyfi_member,
}

/// # Safety
/// The texts end with zeros, and the hash has 32 bytes or is null.
unsafe fn make(
    namespace: *const c_char,
    name: *const c_char,
    hash: *const u8,
    members: &[Member],
) -> *const sys::rosidl_message_type_support_t {
    let raw: Vec<sys::wrapyfi_member> = members.iter().map(|member| member.raw).collect();
    // SAFETY: as above, and so many members lie in a row; all are copied.
    unsafe { sys::wrapyfi_message_type(namespace, name, hash, raw.as_ptr(), raw.len()) }
}

/// Numbers of kinds in `rosidl_typesupport_introspection_c`, by those of REP-2016: a nested type, integers, floats, characters,
/// a boolean, a byte, texts.
const KINDS: [u8; 23] =
    [0, 18, 9, 8, 11, 10, 13, 12, 15, 14, 1, 2, 3, 4, 5, 6, 7, 16, 17, 16, 17, 16, 17];

/// Most members of a type, those of a part counted wherever the part stands: a middleware walks over all of them, and a type
/// that has another one twice, which has a third one twice, grows without end.
const MAX_MEMBERS: usize = 1 << 16;

/// Types that a type refers to.
struct Nested<'a> {
    all: &'a TypeDescription,
    /// Type supports by name, each with the number of its members: each type is made once, however often it is referred to.
    made: HashMap<&'a str, (*const sys::rosidl_message_type_support_t, usize)>,
}

impl<'a> Nested<'a> {
    /// Members of a type, and their number with those of their parts; `None` where one of them is not described or they are more
    /// than [`MAX_MEMBERS`], so that none is told.
    fn members(
        &mut self,
        fields: &'a [FieldDescription],
        depth: usize,
    ) -> Option<(Vec<Member>, usize)> {
        let (mut members, mut size) = (Vec::with_capacity(fields.len()), 0_usize);
        for field in fields {
            let (member, of_parts) = self.member(field, depth)?;
            members.push(member);
            size = size.saturating_add(1).saturating_add(of_parts);
        }
        (size <= MAX_MEMBERS).then_some((members, size))
    }

    fn member(&mut self, field: &'a FieldDescription, depth: usize) -> Option<(Member, usize)> {
        let (container, element) = (field.type_id / CONTAINER_STEP, field.type_id % CONTAINER_STEP);
        let (nested, size) = match field.nested_type_name.as_str() {
            "" => (ptr::null(), 0),
            name => self.nested(name, depth + 1)?,
        };
        let name = CString::new(field.name.as_str()).ok()?;
        let raw = sys::wrapyfi_member {
            name: name.as_ptr(),
            kind: *KINDS.get(usize::from(element))?,
            text_bound: usize::try_from(field.string_capacity).ok()?,
            nested,
            is_array: container == 1,
            is_sequence: container > 1,
            count: usize::try_from(field.capacity).ok()?,
        };
        Some((Member { _name: name, raw }, size))
    }

    fn nested(
        &mut self,
        name: &'a str,
        depth: usize,
    ) -> Option<(*const sys::rosidl_message_type_support_t, usize)> {
        if let Some(&made) = self.made.get(name) {
            return Some(made);
        }
        let mut others = self.all.referenced_type_descriptions.iter();
        let found = others.find(|one| one.type_name == name && depth <= MAX_DEPTH)?;
        let (members, size) = self.members(&found.fields, depth)?;
        let [namespace, short] = split(name).ok()?;
        // SAFETY: the texts end with zeros; there is no hash.
        let made = unsafe { make(namespace.as_ptr(), short.as_ptr(), ptr::null(), &members) };
        if made.is_null() {
            return None;
        }
        self.made.insert(name, (made, size));
        Some((made, size))
    }
}

/// Type support of a service type, with its hash and those of its request and its response.
pub(crate) fn service(type_name: &str, hashes: &Hashes) -> Result<ServiceType, Fault> {
    let [own, request, response] = hashes.each_ref().map(|hash| pointer(hash.as_ref()));
    // SAFETY: as in `message`.
    kept(&SERVICES, (type_name, *hashes), |namespace, name| unsafe {
        sys::wrapyfi_service_type(namespace, name, own, request, response)
    })
}

#[cfg(test)]
mod tests {
    use wrapyfi_interfaces::description::IndividualTypeDescription;

    use super::*;

    #[test]
    fn names_are_split_at_the_type() {
        let [namespace, name] = split("sensor_msgs/msg/Image").unwrap();
        assert_eq!(namespace.to_str(), Ok("sensor_msgs::msg"));
        assert_eq!(name.to_str(), Ok("Image"));
        for wrong in ["", "Image", "msg/Image", "a/b/C\0"] {
            assert!(split(wrong).is_err(), "{wrong:?}");
        }
    }

    #[test]
    fn a_type_has_one_support() {
        let of = |hash| message(&TypeInfo { name: "a/msg/B", hash, description: None }).unwrap();
        let first = of(Some([1; 32]));
        assert_eq!(first.0, of(Some([1; 32])).0);
        assert_ne!(first.0, of(None).0);
    }

    #[test]
    fn members_have_their_kinds_and_bounds() {
        let field = |name: &str, type_id, capacity, nested: &str| FieldDescription {
            name: name.to_owned(),
            type_id,
            capacity,
            string_capacity: 0,
            nested_type_name: nested.to_owned(),
            default: None,
        };
        let inner = vec![field("x", 11, 0, "")];
        let outer = vec![
            field("points", 1 + 3 * CONTAINER_STEP, 0, "a/msg/Point"),
            field("six", 6 + CONTAINER_STEP, 6, ""),
            field("few", 17 + 2 * CONTAINER_STEP, 4, ""),
        ];
        let one =
            |name: &str, fields| IndividualTypeDescription { type_name: name.to_owned(), fields };
        let described = TypeDescription {
            type_description: one("a/msg/Path", outer),
            referenced_type_descriptions: vec![one("a/msg/Point", inner)],
        };
        let members = |of: &TypeDescription| {
            Nested { all: of, made: HashMap::new() }.members(&of.type_description.fields, 0)
        };
        let (found, size) = members(&described).unwrap();
        assert_eq!(size, 4, "three, and one in a part");
        let told = found.iter().map(|it| {
            let raw = &it.raw;
            (raw.kind, raw.nested.is_null(), raw.is_array, raw.is_sequence, raw.count)
        });
        assert_eq!(
            told.collect::<Vec<_>>(),
            [(18, false, false, true, 0), (13, true, true, false, 6), (16, true, false, true, 4)]
        );
        let alone = TypeDescription { referenced_type_descriptions: Vec::new(), ..described };
        assert!(members(&alone).is_none());
        // Each type has the next one twice.
        let twice = |n: usize| {
            let next = format!("a/msg/T{}", n + 1);
            one(&format!("a/msg/T{n}"), vec![field("a", 145, 0, &next), field("b", 145, 0, &next)])
        };
        let mut parts: Vec<_> = (1..60).map(twice).collect();
        parts.push(one("a/msg/T60", vec![field("x", 11, 0, "")]));
        let endless =
            TypeDescription { type_description: twice(0), referenced_type_descriptions: parts };
        assert!(members(&endless).is_none());
    }

    /// Fast CDR throws where its buffer has no room: the exception ends in the type support.
    #[test]
    fn an_exception_of_fast_cdr_is_a_refusal() {
        let data = [7; 64];
        let body =
            sys::wrapyfi_body { data: data.as_ptr(), length: data.len(), ..Default::default() };
        let mut buffer = [0; 64];
        for (capacity, fits) in [(64, true), (63, false), (0, false)] {
            buffer.fill(0);
            // SAFETY: `body` points to `data`, and the buffer has at least `capacity` bytes.
            let wrote = unsafe { sys::wrapyfi_body_write(&body, buffer.as_mut_ptr(), capacity) };
            assert_eq!(wrote, fits, "{capacity}");
            assert!(!fits || buffer == data);
        }
    }
}
