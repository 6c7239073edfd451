//! The functions and classes a pickle may name. None is ever called: each one only describes data,
//! and the plug-in turns the description into a value.
//!
//! Lists are sorted, so that a pickle made of names costs no more than any other.

use std::fmt;

/// A function or class on the list.
///
/// ```
/// use wrapyfi_plugins::pickle::Allowed;
/// let dtype = Allowed::NUMPY.find("numpy", "dtype").unwrap();
/// assert!(dtype.callable && dtype.is("numpy.dtype"));
/// let array = Allowed::NUMPY.find("numpy", "ndarray").unwrap();
/// assert!(!array.callable); // only an argument of other calls
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Global {
    /// Python module, by its Python 3 name.
    pub module: &'static str,
    /// Name in the module.
    pub name: &'static str,
    /// True when a pickle may apply it to arguments; false where it is only an argument itself.
    pub callable: bool,
}

impl fmt::Display for Global {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}", self.module, self.name)
    }
}

const fn call(module: &'static str, name: &'static str) -> Global {
    Global { module, name, callable: true }
}

const fn data(module: &'static str, name: &'static str) -> Global {
    Global { module, name, callable: false }
}

/// Functions and classes by module.
macro_rules! family {
    ($($module:literal: $($kind:ident $name:literal),+;)+) => {
        &[$($($kind($module, $name),)+)+]
    };
}

/// Globals that the pickles of one plug-in may name.
///
/// ```
/// use wrapyfi_plugins::pickle::Allowed;
/// assert!(Allowed::NUMPY.find("numpy", "dtype").is_some());
/// assert!(Allowed::BUILTINS.find("numpy", "dtype").is_none());
/// ```
#[derive(Debug, Clone, Copy)]
pub struct Allowed {
    families: &'static [&'static [Global]],
    /// True where the pickle may refer to things beside it by an id.
    pub(super) persistent_ids: bool,
}

impl Allowed {
    /// Plain data of Python's own types.
    pub const BUILTINS: Self = Self::new(&[BUILTINS]);
    /// Plain data and NumPy arrays.
    pub const NUMPY: Self = Self::new(&[BUILTINS, NUMPY]);
    /// `PandasData`: frames, series and indices of pandas 2 and 3, NumPy or Arrow inside.
    pub const PANDAS: Self = Self::new(&[BUILTINS, NUMPY, PANDAS, PYARROW]);
    /// `PyArrowArray`: arrays and tables.
    pub const PYARROW: Self = Self::new(&[BUILTINS, PYARROW]);
    /// `PytorchTensor`: `data.pkl` of a `torch.save` file. The only one with persistent ids, which
    /// name the storages in the file.
    pub const TORCH: Self = Self { families: &[TORCH], persistent_ids: true };
    /// `PaddleTensor`: a named array.
    pub const PADDLE: Self = Self::new(&[BUILTINS, NUMPY]);
    /// `TraxArray`: a JAX array.
    pub const JAX: Self = Self::new(&[BUILTINS, NUMPY, JAX]);

    /// A list made of `families`, each one sorted by module and name.
    pub const fn new(families: &'static [&'static [Global]]) -> Self {
        Self { families, persistent_ids: false }
    }

    /// The entry for `module.name`, whose module may have its Python 2 name.
    pub fn find(&self, module: &str, name: &str) -> Option<&'static Global> {
        let (module, name) = match (module, name) {
            ("__builtin__", "xrange") => ("builtins", "range"),
            ("__builtin__", name) => ("builtins", name),
            ("copy_reg", name) => ("copyreg", name),
            other => other,
        };
        self.families.iter().find_map(|family| {
            let found = family.binary_search_by(|global| {
                global.module.cmp(module).then_with(|| global.name.cmp(name))
            });
            found.ok().and_then(|index| family.get(index))
        })
    }

    /// [`GETATTR`], where `module.name` is `getattr` and a method is on the list: a class method of
    /// C, such as `ZoneInfo._unpickle`, is pickled in this way only.
    pub(super) fn getter(&self, module: &str, name: &str) -> Option<&'static Global> {
        let is_getter = matches!(module, "builtins" | "__builtin__") && name == "getattr";
        (is_getter && self.find("zoneinfo", "ZoneInfo._unpickle").is_some()).then_some(&GETATTR)
    }
}

/// Python's `getattr`, in pickles whose list has methods. It is on no list: applied to a class and
/// text it stands for the method of that name, which must be on the list; anything else is refused.
pub(super) static GETATTR: Global = data("builtins", "getattr");

const BUILTINS: &[Global] = family! {
    "_codecs": call "encode";
    "builtins": data "Ellipsis", data "NotImplemented", data "bool", call "bytearray", call "bytes",
        call "complex", data "dict", data "float", call "frozenset", data "int", call "list",
        data "object", call "range", call "set", call "slice", data "str", call "tuple";
    "collections": call "OrderedDict";
    "copyreg": call "_reconstructor";
    "datetime": call "date", call "datetime", call "time", call "timedelta", call "timezone";
    "decimal": call "Decimal";
};

const NUMPY: &[Global] = family! {
    "numpy": call "dtype", data "matrix", data "ndarray";
    "numpy._core.multiarray": call "_reconstruct", call "scalar";
    "numpy._core.numeric": call "_frombuffer";
    "numpy.core.multiarray": call "_reconstruct", call "scalar";
    "numpy.core.numeric": call "_frombuffer";
    "numpy.matrixlib.defmatrix": data "matrix";
};

const JAX: &[Global] = family! {
    "jax._src.array": call "_reconstruct_array";
    "ml_dtypes": data "bfloat16";
};

const PANDAS: &[Global] = family! {
    "pandas": call "ArrowDtype", call "BooleanDtype", data "Categorical",
        call "Categorical.from_codes", call "CategoricalDtype", data "CategoricalIndex",
        call "DataFrame", data "DatetimeIndex", call "DatetimeTZDtype", call "Float32Dtype",
        call "Float64Dtype", call "Index", call "Int16Dtype", call "Int32Dtype", call "Int64Dtype",
        call "Int8Dtype", call "IntervalDtype", data "IntervalIndex", data "MultiIndex",
        call "MultiIndex.from_tuples", data "NA", call "PeriodDtype", data "PeriodIndex",
        call "RangeIndex", call "Series", call "SparseDtype", call "StringDtype",
        data "TimedeltaIndex", call "UInt16Dtype", call "UInt32Dtype", call "UInt64Dtype",
        call "UInt8Dtype";
    "pandas._libs.arrays": call "__pyx_unpickle_NDArrayBacked";
    "pandas._libs.internals": call "_unpickle_block";
    "pandas._libs.interval": call "__pyx_unpickle_IntervalMixin";
    "pandas._libs.missing": data "NA";
    "pandas._libs.sparse": call "IntIndex";
    "pandas._libs.tslibs.nattype": call "__nat_unpickle", call "_nat_unpickle";
    "pandas._libs.tslibs.offsets": call "BQuarterBegin", call "BQuarterEnd", call "BYearBegin",
        call "BYearEnd", call "BusinessDay", call "BusinessMonthBegin", call "BusinessMonthEnd",
        call "Day", call "Hour", call "Micro", call "Milli", call "Minute", call "MonthBegin",
        call "MonthEnd", call "Nano", call "QuarterBegin", call "QuarterEnd", call "Second",
        call "SemiMonthBegin", call "SemiMonthEnd", call "Week", call "YearBegin", call "YearEnd";
    "pandas._libs.tslibs.timedeltas": call "_timedelta_unpickle";
    "pandas._libs.tslibs.timestamps": call "_unpickle_timestamp";
    "pandas.arrays": call "ArrowExtensionArray", call "ArrowStringArray", call "BooleanArray",
        data "DatetimeArray", call "FloatingArray", call "IntegerArray", data "IntervalArray",
        call "IntervalArray.from_arrays", call "PeriodArray", call "SparseArray", data "StringArray", data "TimedeltaArray";
    "pandas.core.arrays.arrow.array": call "ArrowExtensionArray";
    "pandas.core.arrays.boolean": call "BooleanArray", call "BooleanDtype";
    "pandas.core.arrays.categorical": data "Categorical";
    "pandas.core.arrays.datetimes": data "DatetimeArray";
    "pandas.core.arrays.floating": call "Float32Dtype", call "Float64Dtype", call "FloatingArray";
    "pandas.core.arrays.integer": call "Int16Dtype", call "Int32Dtype", call "Int64Dtype",
        call "Int8Dtype", call "IntegerArray", call "UInt16Dtype", call "UInt32Dtype",
        call "UInt64Dtype", call "UInt8Dtype";
    "pandas.core.arrays.interval": data "IntervalArray";
    "pandas.core.arrays.period": data "PeriodArray";
    "pandas.core.arrays.sparse.array": call "SparseArray";
    "pandas.core.arrays.string_": data "StringArray", call "StringDtype";
    "pandas.core.arrays.string_arrow": call "ArrowStringArray";
    "pandas.core.arrays.timedeltas": data "TimedeltaArray";
    "pandas.core.dtypes.dtypes": call "ArrowDtype", call "CategoricalDtype", call "DatetimeTZDtype",
        call "IntervalDtype", call "PeriodDtype", call "SparseDtype";
    "pandas.core.frame": call "DataFrame";
    "pandas.core.indexes.base": data "Index", call "_new_Index";
    "pandas.core.indexes.category": data "CategoricalIndex";
    "pandas.core.indexes.datetimes": data "DatetimeIndex", call "_new_DatetimeIndex";
    "pandas.core.indexes.interval": data "IntervalIndex", call "_new_IntervalIndex";
    "pandas.core.indexes.multi": data "MultiIndex";
    "pandas.core.indexes.period": data "PeriodIndex";
    "pandas.core.indexes.range": data "RangeIndex";
    "pandas.core.indexes.timedeltas": data "TimedeltaIndex", call "_new_TimedeltaIndex";
    "pandas.core.internals.managers": call "BlockManager", call "SingleBlockManager";
    "pandas.core.series": call "Series";
    "pytz": call "FixedOffset", call "_UTC", call "_p";
    "zoneinfo": data "ZoneInfo", call "ZoneInfo._unpickle";
};

const PYARROW: &[Global] = family! {
    "pyarrow.lib": call "_reconstruct_record_batch", call "_reconstruct_table",
        call "_restore_array", call "binary", call "chunked_array", call "decimal128",
        call "decimal256", call "dictionary", call "duration", call "field", call "large_list",
        call "list_", call "map_", call "py_buffer", call "scalar", call "schema", call "struct",
        call "time32", call "time64", call "timestamp", call "type_for_alias";
};

/// Two functions that put a tensor together, one for parameters, and the element types.
const TORCH: &[Global] = family! {
    "collections": call "OrderedDict";
    "torch": data "BFloat16Storage", data "BoolStorage", data "ByteStorage", data "CharStorage",
        data "ComplexDoubleStorage", data "ComplexFloatStorage", data "DoubleStorage",
        data "FloatStorage", data "HalfStorage", data "IntStorage", data "LongStorage",
        data "ShortStorage", data "uint16", data "uint32", data "uint64";
    "torch._utils": call "_rebuild_parameter", call "_rebuild_tensor_v2", call "_rebuild_tensor_v3";
    "torch.storage": data "UntypedStorage";
};

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Allowed; 7] = [
        Allowed::BUILTINS,
        Allowed::NUMPY,
        Allowed::PANDAS,
        Allowed::PYARROW,
        Allowed::TORCH,
        Allowed::PADDLE,
        Allowed::JAX,
    ];

    fn all(allowed: Allowed) -> impl Iterator<Item = &'static Global> {
        allowed.families.iter().copied().flatten()
    }

    #[test]
    fn every_entry_is_found() {
        for allowed in ALL {
            for global in all(allowed) {
                assert_eq!(allowed.find(global.module, global.name), Some(global), "{global}");
            }
        }
        let range = Allowed::BUILTINS.find("__builtin__", "xrange").unwrap();
        assert_eq!(range.to_string(), "builtins.range");
        assert!(Allowed::BUILTINS.find("copy_reg", "_reconstructor").is_some());
    }

    #[test]
    fn nothing_that_acts_is_listed() {
        let names = ["eval", "exec", "getattr", "setattr", "__import__", "open", "type", "map"];
        for allowed in ALL {
            for name in names {
                assert_eq!(allowed.find("builtins", name), None);
                assert_eq!(allowed.find("__builtin__", name), None);
            }
            let modules = ["os", "posix", "nt", "subprocess", "sys", "importlib", "operator"];
            assert!(all(allowed).all(|global| !modules.contains(&global.module)));
            // Constructors that are methods of their class.
            let constructors = [
                "Categorical.from_codes",
                "IntervalArray.from_arrays",
                "MultiIndex.from_tuples",
                "ZoneInfo._unpickle",
            ];
            let is_path = |global: &&Global| {
                global.name.contains('.') && !constructors.contains(&global.name)
            };
            assert_eq!(all(allowed).find(is_path), None, "no attribute paths");
        }
    }
}
