% Names with prefixes, in and out: knowrob:'Handle' is 'http://knowrob.org/kb/knowrob.owl#Handle'.

:- module(mindstage_names,
          [ spelt/2, shown_name/2, keep_prefixes/1,
            rdf_register_prefix/2, rdf_register_prefix/3, rdf_register_ns/2, rdf_register_ns/3,
            rdf_current_prefix/2, rdf_current_ns/2, rdf_global_id/2 ]).
:- use_module(library(apply)).
:- use_module(library(error)).
:- use_module(library(lists)).

:- dynamic given/2, registered/2.

known_prefix(Prefix, Start) :- registered(Prefix, Start).
known_prefix(Prefix, Start) :- given(Prefix, Start), \+ registered(Prefix, _).

% keep_prefixes(+Pairs): those that come with what is known; what somebody registered comes first.
keep_prefixes(Pairs) :-
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

% rdf_global_id(?Prefix:Name, ?Iri): either way.
rdf_global_id(Name, Iri) :- nonvar(Name), Name = Prefix:Local, atom(Prefix), var(Local), !,
    known_prefix(Prefix, Start),
    atom_concat(Start, Local, Iri).
rdf_global_id(Name, Iri) :- nonvar(Name), !, spelt(Name, Iri).
rdf_global_id(Name, Iri) :- must_be(atom, Iri), ( shown_name(Iri, Found) -> Name = Found ; Name = Iri ).

% spelt(+Term, -Spelt): every Prefix:Name in it written out.
spelt(Term, Spelt) :-
    must_be(acyclic, Term),
    written_out(Term, Spelt).

written_out(Term, Term) :- \+ compound(Term), !.
written_out(Prefix:Name, Iri) :- !,
    must_be(atom, Prefix),
    must_be(atomic, Name),
    (   known_prefix(Prefix, Start)
    ->  atom_concat(Start, Name, Iri)
    ;   findall(Known, known_prefix(Known, _), All),
        format(string(Sentence), "no prefix ~q is known; there is ~w; rdf_register_prefix(Prefix, Iri) adds one",
               [Prefix, All]),
        throw(mindstage_error(prefix_unknown, Sentence))
    ).
written_out(Term, Spelt) :-
    compound_name_arguments(Term, Name, Arguments),
    maplist(written_out, Arguments, Written),
    compound_name_arguments(Spelt, Name, Written).

% shown_name(+Iri, -Short): the same with the prefix that says most of it.
shown_name(Iri, Prefix:Name) :-
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
    mindstage_names:shown_name(Iri, Prefix:Name),
    !,
    format("~q:~q", [Prefix, Name]).
