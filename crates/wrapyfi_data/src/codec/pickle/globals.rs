//! The functions and classes a pickle may name. None is ever called: each one only describes data,
//! and whoever knows the plug-in turns the description into a value.
//!
//! Lists are sorted, so that a pickle made of names costs no more than any other.

use std::fmt;

/// A function or class on the list.
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

/// Globals that the pickles of one plug-in may name.
#[derive(Debug, Clone, Copy)]
pub struct Allowed {
    families: &'static [&'static [Global]],
    persistent_ids: bool,
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
    pub const TORCH: Self = Self::new(&[TORCH]).with_persistent_ids();
    /// `PaddleTensor`: a named array.
    pub const PADDLE: Self = Self::new(&[BUILTINS, NUMPY]);
    /// `TraxArray`: a JAX array.
    pub const JAX: Self = Self::new(&[BUILTINS, NUMPY, JAX]);

    /// A list made of `families`, each one sorted by module and name.
    #[must_use]
    pub const fn new(families: &'static [&'static [Global]]) -> Self {
        Self { families, persistent_ids: false }
    }

    /// The same list, for pickles that may refer to things beside them by an id.
    #[must_use]
    pub const fn with_persistent_ids(self) -> Self {
        Self { persistent_ids: true, ..self }
    }

    /// True when persistent ids are read.
    #[must_use]
    pub const fn has_persistent_ids(&self) -> bool {
        self.persistent_ids
    }

    /// The entry for `module.name`, whose module may have its Python 2 name.
    #[must_use]
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

    /// Every entry, for documentation and tests.
    pub fn iter(&self) -> impl Iterator<Item = &'static Global> {
        self.families.iter().flat_map(|family| family.iter())
    }
}

/// Python's `getattr`, in pickles whose list has methods. It is on no list: applied to a class and
/// text it stands for the method of that name, which must be on the list; anything else is refused.
pub(super) static GETATTR: Global = data("builtins", "getattr");

const BUILTINS: &[Global] = &[
    call("_codecs", "encode"),
    data("builtins", "Ellipsis"),
    data("builtins", "NotImplemented"),
    data("builtins", "bool"),
    call("builtins", "bytearray"),
    call("builtins", "bytes"),
    call("builtins", "complex"),
    data("builtins", "dict"),
    data("builtins", "float"),
    call("builtins", "frozenset"),
    data("builtins", "int"),
    call("builtins", "list"),
    data("builtins", "object"),
    call("builtins", "range"),
    call("builtins", "set"),
    call("builtins", "slice"),
    data("builtins", "str"),
    call("builtins", "tuple"),
    call("collections", "OrderedDict"),
    call("copyreg", "_reconstructor"),
    call("datetime", "date"),
    call("datetime", "datetime"),
    call("datetime", "time"),
    call("datetime", "timedelta"),
    call("datetime", "timezone"),
    call("decimal", "Decimal"),
];

const NUMPY: &[Global] = &[
    call("numpy", "dtype"),
    data("numpy", "matrix"),
    data("numpy", "ndarray"),
    call("numpy._core.multiarray", "_reconstruct"),
    call("numpy._core.multiarray", "scalar"),
    call("numpy._core.numeric", "_frombuffer"),
    call("numpy.core.multiarray", "_reconstruct"),
    call("numpy.core.multiarray", "scalar"),
    call("numpy.core.numeric", "_frombuffer"),
    data("numpy.matrixlib.defmatrix", "matrix"),
];

const JAX: &[Global] =
    &[call("jax._src.array", "_reconstruct_array"), data("ml_dtypes", "bfloat16")];

const PANDAS: &[Global] = &[
    call("pandas", "ArrowDtype"),
    call("pandas", "BooleanDtype"),
    data("pandas", "Categorical"),
    call("pandas", "Categorical.from_codes"),
    call("pandas", "CategoricalDtype"),
    data("pandas", "CategoricalIndex"),
    call("pandas", "DataFrame"),
    data("pandas", "DatetimeIndex"),
    call("pandas", "DatetimeTZDtype"),
    call("pandas", "Float32Dtype"),
    call("pandas", "Float64Dtype"),
    call("pandas", "Index"),
    call("pandas", "Int16Dtype"),
    call("pandas", "Int32Dtype"),
    call("pandas", "Int64Dtype"),
    call("pandas", "Int8Dtype"),
    call("pandas", "IntervalDtype"),
    data("pandas", "IntervalIndex"),
    data("pandas", "MultiIndex"),
    call("pandas", "MultiIndex.from_tuples"),
    data("pandas", "NA"),
    call("pandas", "PeriodDtype"),
    data("pandas", "PeriodIndex"),
    call("pandas", "RangeIndex"),
    call("pandas", "Series"),
    call("pandas", "SparseDtype"),
    call("pandas", "StringDtype"),
    data("pandas", "TimedeltaIndex"),
    call("pandas", "UInt16Dtype"),
    call("pandas", "UInt32Dtype"),
    call("pandas", "UInt64Dtype"),
    call("pandas", "UInt8Dtype"),
    call("pandas._libs.arrays", "__pyx_unpickle_NDArrayBacked"),
    call("pandas._libs.internals", "_unpickle_block"),
    call("pandas._libs.interval", "__pyx_unpickle_IntervalMixin"),
    data("pandas._libs.missing", "NA"),
    call("pandas._libs.sparse", "IntIndex"),
    call("pandas._libs.tslibs.nattype", "__nat_unpickle"),
    call("pandas._libs.tslibs.nattype", "_nat_unpickle"),
    call("pandas._libs.tslibs.offsets", "BQuarterBegin"),
    call("pandas._libs.tslibs.offsets", "BQuarterEnd"),
    call("pandas._libs.tslibs.offsets", "BYearBegin"),
    call("pandas._libs.tslibs.offsets", "BYearEnd"),
    call("pandas._libs.tslibs.offsets", "BusinessDay"),
    call("pandas._libs.tslibs.offsets", "BusinessMonthBegin"),
    call("pandas._libs.tslibs.offsets", "BusinessMonthEnd"),
    call("pandas._libs.tslibs.offsets", "Day"),
    call("pandas._libs.tslibs.offsets", "Hour"),
    call("pandas._libs.tslibs.offsets", "Micro"),
    call("pandas._libs.tslibs.offsets", "Milli"),
    call("pandas._libs.tslibs.offsets", "Minute"),
    call("pandas._libs.tslibs.offsets", "MonthBegin"),
    call("pandas._libs.tslibs.offsets", "MonthEnd"),
    call("pandas._libs.tslibs.offsets", "Nano"),
    call("pandas._libs.tslibs.offsets", "QuarterBegin"),
    call("pandas._libs.tslibs.offsets", "QuarterEnd"),
    call("pandas._libs.tslibs.offsets", "Second"),
    call("pandas._libs.tslibs.offsets", "SemiMonthBegin"),
    call("pandas._libs.tslibs.offsets", "SemiMonthEnd"),
    call("pandas._libs.tslibs.offsets", "Week"),
    call("pandas._libs.tslibs.offsets", "YearBegin"),
    call("pandas._libs.tslibs.offsets", "YearEnd"),
    call("pandas._libs.tslibs.timedeltas", "_timedelta_unpickle"),
    call("pandas._libs.tslibs.timestamps", "_unpickle_timestamp"),
    call("pandas.arrays", "ArrowExtensionArray"),
    call("pandas.arrays", "ArrowStringArray"),
    call("pandas.arrays", "BooleanArray"),
    data("pandas.arrays", "DatetimeArray"),
    call("pandas.arrays", "FloatingArray"),
    call("pandas.arrays", "IntegerArray"),
    data("pandas.arrays", "IntervalArray"),
    call("pandas.arrays", "PeriodArray"),
    call("pandas.arrays", "SparseArray"),
    data("pandas.arrays", "StringArray"),
    data("pandas.arrays", "TimedeltaArray"),
    call("pandas.core.arrays.arrow.array", "ArrowExtensionArray"),
    call("pandas.core.arrays.boolean", "BooleanArray"),
    call("pandas.core.arrays.boolean", "BooleanDtype"),
    data("pandas.core.arrays.categorical", "Categorical"),
    data("pandas.core.arrays.datetimes", "DatetimeArray"),
    call("pandas.core.arrays.floating", "Float32Dtype"),
    call("pandas.core.arrays.floating", "Float64Dtype"),
    call("pandas.core.arrays.floating", "FloatingArray"),
    call("pandas.core.arrays.integer", "Int16Dtype"),
    call("pandas.core.arrays.integer", "Int32Dtype"),
    call("pandas.core.arrays.integer", "Int64Dtype"),
    call("pandas.core.arrays.integer", "Int8Dtype"),
    call("pandas.core.arrays.integer", "IntegerArray"),
    call("pandas.core.arrays.integer", "UInt16Dtype"),
    call("pandas.core.arrays.integer", "UInt32Dtype"),
    call("pandas.core.arrays.integer", "UInt64Dtype"),
    call("pandas.core.arrays.integer", "UInt8Dtype"),
    data("pandas.core.arrays.interval", "IntervalArray"),
    data("pandas.core.arrays.period", "PeriodArray"),
    call("pandas.core.arrays.sparse.array", "SparseArray"),
    data("pandas.core.arrays.string_", "StringArray"),
    call("pandas.core.arrays.string_", "StringDtype"),
    call("pandas.core.arrays.string_arrow", "ArrowStringArray"),
    data("pandas.core.arrays.timedeltas", "TimedeltaArray"),
    call("pandas.core.dtypes.dtypes", "ArrowDtype"),
    call("pandas.core.dtypes.dtypes", "CategoricalDtype"),
    call("pandas.core.dtypes.dtypes", "DatetimeTZDtype"),
    call("pandas.core.dtypes.dtypes", "IntervalDtype"),
    call("pandas.core.dtypes.dtypes", "PeriodDtype"),
    call("pandas.core.dtypes.dtypes", "SparseDtype"),
    call("pandas.core.frame", "DataFrame"),
    data("pandas.core.indexes.base", "Index"),
    call("pandas.core.indexes.base", "_new_Index"),
    data("pandas.core.indexes.category", "CategoricalIndex"),
    data("pandas.core.indexes.datetimes", "DatetimeIndex"),
    call("pandas.core.indexes.datetimes", "_new_DatetimeIndex"),
    data("pandas.core.indexes.interval", "IntervalIndex"),
    call("pandas.core.indexes.interval", "_new_IntervalIndex"),
    data("pandas.core.indexes.multi", "MultiIndex"),
    data("pandas.core.indexes.period", "PeriodIndex"),
    data("pandas.core.indexes.range", "RangeIndex"),
    data("pandas.core.indexes.timedeltas", "TimedeltaIndex"),
    call("pandas.core.indexes.timedeltas", "_new_TimedeltaIndex"),
    call("pandas.core.internals.managers", "BlockManager"),
    call("pandas.core.internals.managers", "SingleBlockManager"),
    call("pandas.core.series", "Series"),
    call("pytz", "FixedOffset"),
    call("pytz", "_UTC"),
    call("pytz", "_p"),
    data("zoneinfo", "ZoneInfo"),
    call("zoneinfo", "ZoneInfo._unpickle"),
];

const PYARROW: &[Global] = &[
    call("pyarrow.lib", "_reconstruct_record_batch"),
    call("pyarrow.lib", "_reconstruct_table"),
    call("pyarrow.lib", "_restore_array"),
    call("pyarrow.lib", "binary"),
    call("pyarrow.lib", "chunked_array"),
    call("pyarrow.lib", "decimal128"),
    call("pyarrow.lib", "decimal256"),
    call("pyarrow.lib", "dictionary"),
    call("pyarrow.lib", "duration"),
    call("pyarrow.lib", "field"),
    call("pyarrow.lib", "large_list"),
    call("pyarrow.lib", "list_"),
    call("pyarrow.lib", "map_"),
    call("pyarrow.lib", "py_buffer"),
    call("pyarrow.lib", "scalar"),
    call("pyarrow.lib", "schema"),
    call("pyarrow.lib", "struct"),
    call("pyarrow.lib", "time32"),
    call("pyarrow.lib", "time64"),
    call("pyarrow.lib", "timestamp"),
    call("pyarrow.lib", "type_for_alias"),
];

/// Two functions that put a tensor together, one for parameters, and the element types.
const TORCH: &[Global] = &[
    call("collections", "OrderedDict"),
    data("torch", "BFloat16Storage"),
    data("torch", "BoolStorage"),
    data("torch", "ByteStorage"),
    data("torch", "CharStorage"),
    data("torch", "ComplexDoubleStorage"),
    data("torch", "ComplexFloatStorage"),
    data("torch", "DoubleStorage"),
    data("torch", "FloatStorage"),
    data("torch", "HalfStorage"),
    data("torch", "IntStorage"),
    data("torch", "LongStorage"),
    data("torch", "ShortStorage"),
    data("torch", "uint16"),
    data("torch", "uint32"),
    data("torch", "uint64"),
    call("torch._utils", "_rebuild_parameter"),
    call("torch._utils", "_rebuild_tensor_v2"),
    call("torch._utils", "_rebuild_tensor_v3"),
    data("torch.storage", "UntypedStorage"),
];

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

    #[test]
    fn every_entry_is_found() {
        for allowed in ALL {
            for global in allowed.iter() {
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
            assert!(allowed.iter().all(|global| !modules.contains(&global.module)));
            // Constructors that are methods of their class.
            let constructors =
                ["Categorical.from_codes", "MultiIndex.from_tuples", "ZoneInfo._unpickle"];
            let is_path = |global: &&Global| {
                global.name.contains('.') && !constructors.contains(&global.name)
            };
            assert_eq!(allowed.iter().find(is_path), None, "no attribute paths");
        }
    }
}
