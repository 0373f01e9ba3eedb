"""Words that languages keep for themselves, in lower case: no feature, action or function can be called so."""

from __future__ import annotations

import keyword

# Of C and C++, of <float.h>, and what compilers define for themselves.
_C = """
alignas alignof and and_eq asm atomic auto bitand bitor bool break case catch char char16_t char32_t char8_t class
co_await co_return co_yield compl complex concept const const_cast consteval constexpr constinit continue decltype
default delete do double dynamic_cast else enum explicit export extern false far final float for fortran friend goto
huge i386 if imaginary import inline int interrupt linux long main module mutable namespace near new noexcept
noreturn not not_eq nullptr operator or or_eq override private protected public register reinterpret_cast requires
restrict return short signed sizeof static static_assert static_cast struct switch template this thread_local throw
true try typedef typeid typename typeof typeof_unqual union unix unsigned using virtual void volatile wchar_t while
xor xor_eq dbl_dig dbl_epsilon dbl_mant_dig dbl_max dbl_max_exp dbl_min dbl_min_exp decimal_dig flt_dig flt_epsilon
flt_eval_method flt_mant_dig flt_max flt_max_exp flt_min flt_min_exp flt_radix flt_rounds ldbl_dig ldbl_epsilon
ldbl_mant_dig ldbl_max ldbl_min
"""
# Keywords, types and functions of IEC 61131-3, and what widespread systems keep for themselves beside them.
_ST = """
abs abstract acos action add adr and and_then andn any any_bit any_date any_int any_num any_real array asin at atan
atan2 begin bitadr bool by byte cal calc calcn case ceil char class concat configuration constant continue cos ctd
ctu ctud date date_and_time delete dint div do dt dword else elsif en end_action end_case end_class
end_configuration end_for end_function end_function_block end_if end_interface end_method end_namespace end_program
end_property end_repeat end_resource end_step end_struct end_transition end_type end_union end_var end_while eno eq
exit exp expt extends f_edge f_trig false final find floor for from function function_block ge gt gvl if implements
in ini initial_step insert int interface internal interval is_valid iterator jmp jmpc jmpcn ld ldate ldn ldt le left
len limit lint ln log lower_bound lreal lt ltime ltod lword max method mid min mod move mul mux namespace ne neg
non_retain not null of on or or_else orn override pi pointer pou priority private program property protected ptr
public r r1 r_edge r_trig read_only read_write real ref ref_to reference repeat replace resource ret retain retc
retcn return right rol ror round rs s s1 sel sema shl shr sin single sint sizeof sqrt sr st step stn string struct
sub super tan task test then this time time_of_day to tod tof ton tp transition true trunc type udint uint ulint
union until upper_bound using usint var var_access var_config var_external var_global var_in_out var_input
var_output var_stat var_temp void wchar while with word write wstring xor xorn
"""
_PYTHON = (*keyword.kwlist, *keyword.softkwlist, "FEATURES", "UNITS", "ACTIONS")
_SCIKIT_LEARN = (
    "NODES",
    "VALUES",
    "np",
    "zip",
    "len",
    "float",
    "DecisionTreeClassifier",
    "DecisionTreeRegressor",
)

RESERVED_IN_C = frozenset(_C.split())
RESERVED_IN_ST = frozenset(_ST.split())
RESERVED_IN_PYTHON = frozenset(map(str.lower, _PYTHON))
RESERVED_IN_SCIKIT_LEARN = RESERVED_IN_PYTHON.union(map(str.lower, _SCIKIT_LEARN))
