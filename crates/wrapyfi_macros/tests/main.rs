//! Messages of the macros about mistakes: where they point, and what they advise.

#[test]
fn mistakes_are_pointed_at_with_advice() {
    trybuild::TestCases::new().compile_fail("tests/ui/*.rs");
}
