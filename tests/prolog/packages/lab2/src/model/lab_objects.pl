% A file in the manner of KnowRob's packages.
:- module(lab_objects,
    [ is_tool(r), is_bench(r), tool_on(r,r) -> soma:'isOntopOf', tool_mass(r,?), empty_bench(r) ]).
:- use_module(library('model/DUL/Object'), [ is_physical_object/1, has_physical_part/2 ]).
:- use_module(library('lang/terms/is_a'), [ instance_of/2, subclass_of/2 ]).
:- use_module(library('lang/terms/holds'), [ holds/3 ]).
:- use_module(library('lang/terms/triple')).
:- use_module(library('logging')).
is_tool(X) ?+> instance_of(X, knowrob:'Tool').
is_bench(X) ?> instance_of(X, knowrob:'Table-PieceOfFurniture').
tool_on(X, Y) ?> is_supported_by(X, Y).
tool_mass(X, M) ?> triple(X, knowrob:mass, M), { number(M) }.
empty_bench(X) ?> is_bench(X), \+ is_supported_by(_, X).
