% Prefixed names: knowrob:'Handle' is 'http://knowrob.org/kb/knowrob.owl#Handle'.

:- module(mindstage_prefixes,
          [ expand_prefixes/2, abbreviated_name/2, set_default_prefixes/1,
            rdf_register_prefix/2, rdf_register_prefix/3, rdf_register_ns/2, rdf_register_ns/3,
            rdf_current_prefix/2, rdf_current_ns/2, rdf_global_id/2 ]).
:- use_module(library(apply)).
:- use_module(library(error)).
:- use_module(library(lists)).

:- dynamic given/2, registered/2.

known_prefix(Prefix, Start) :- registered(Prefix, Start).
known_prefix(Prefix, Start) :- given(Prefix, Start), \+ registered(Prefix, _).

% set_default_prefixes(+Pairs): the prefixes of the knowledge base; registered prefixes take precedence.
set_default_prefixes(Pairs) :-
    retractall(given(_, _)),
    forall(member(Prefix-Start, Pairs), assertz(given(Prefix, Start))).

rdf_register_prefix(Prefix, Start) :-
    must_be(atom, Prefix),
    must_be(atom, Start),
    retractall(registered(Prefix, _)),
    asserta(registered(Prefix, Start)).

rdf_register_prefix(Prefix, Start, _) :- rdf_register_prefix(Prefix, Start).
rdf_register_ns(Prefix, Start) :- rdf_register_prefix(Prefix, Start).
rdf_register_ns(Prefix, Start, _) :- rdf_register_prefix(Prefix, Start).
rdf_current_prefix(Prefix, Start) :- known_prefix(Prefix, Start).
rdf_current_ns(Prefix, Start) :- known_prefix(Prefix, Start).

% rdf_global_id(?Prefix:Name, ?Iri): converts in both directions.
rdf_global_id(Name, Iri) :- nonvar(Name), Name = Prefix:Local, atom(Prefix), var(Local), !,
    known_prefix(Prefix, Start),
    atom_concat(Start, Local, Iri).
rdf_global_id(Name, Iri) :- nonvar(Name), !, expand_prefixes(Name, Iri).
rdf_global_id(Name, Iri) :- must_be(atom, Iri), ( abbreviated_name(Iri, Found) -> Name = Found ; Name = Iri ).

% expand_prefixes(+Term, -Expanded): replaces every Prefix:Name in a term by its IRI.
expand_prefixes(Term, Expanded) :-
    must_be(acyclic, Term),
    expand(Term, Expanded).

expand(Term, Term) :- \+ compound(Term), !.
expand(Prefix:Name, Iri) :- !,
    must_be(atom, Prefix),
    must_be(atomic, Name),
    (   known_prefix(Prefix, Start)
    ->  atom_concat(Start, Name, Iri)
    ;   findall(Known, known_prefix(Known, _), All),
        format(string(Sentence), "unknown prefix ~q; known prefixes: ~w; rdf_register_prefix(Prefix, Iri) adds one",
               [Prefix, All]),
        throw(mindstage_error(prefix_unknown, Sentence))
    ).
expand(Term, Expanded) :-
    compound_name_arguments(Term, Name, Arguments),
    maplist(expand, Arguments, Written),
    compound_name_arguments(Expanded, Name, Written).

% abbreviated_name(+Iri, -Short): the prefixed name with the longest matching prefix.
abbreviated_name(Iri, Prefix:Name) :-
    findall(Length-Found, starts(Iri, Found, Length), Starts),
    max_member(Length-Prefix, Starts),
    sub_atom(Iri, Length, _, 0, Name),
    Name \== '',
    \+ ( member(Cut, [#, /]), sub_atom(Name, _, _, _, Cut) ).

starts(Iri, Prefix, Length) :-
    known_prefix(Prefix, Start),
    sub_atom(Iri, 0, Length, _, Start).

:- multifile user:portray/1.
:- dynamic user:portray/1.

user:portray(Iri) :-
    atom(Iri),
    sub_atom(Iri, _, _, _, '://'),
    mindstage_prefixes:abbreviated_name(Iri, Prefix:Name),
    !,
    format("~q:~q", [Prefix, Name]).
