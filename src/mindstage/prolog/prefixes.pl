% Prefixed names: knowrob:'Handle' is 'http://knowrob.org/kb/knowrob.owl#Handle'.
%
% The table of prefixes is that of SWI-Prolog's library(semweb/rdf_prefixes), so that `:- rdf_meta` and libraries that expand
% prefixed names at compile time use the same prefixes.

:- module(mindstage_prefixes,
          [ expand_prefixes/2, abbreviated_name/2, set_default_prefixes/1,
            rdf_register_prefix/2, rdf_register_prefix/3, rdf_register_ns/2, rdf_register_ns/3,
            rdf_current_prefix/2, rdf_current_ns/2, rdf_global_id/2 ]).
:- use_module(library(apply)).
:- use_module(library(error)).
:- use_module(library(lists)).
:- use_module(library(option)).
:- use_module(library(semweb/rdf_prefixes), []).

:- dynamic registered/1, given/1.

known_prefix(Prefix, Start) :- rdf_db:ns(Prefix, Start).

% set_default_prefixes(+Pairs): the prefixes of the knowledge base; registered prefixes take precedence.
set_default_prefixes(Pairs) :-
    forall(( retract(given(Prefix)), \+ registered(Prefix) ), set_prefix(Prefix, none)),
    forall(( member(Prefix-Start, Pairs), \+ registered(Prefix) ),
           ( set_prefix(Prefix, Start), assertz(given(Prefix)) )).

% set_prefix(+Prefix, +Start): replaces a prefix; libraries cache what names were expanded to.
set_prefix(Prefix, Start) :-
    rdf_db:ns(Prefix, Start), !.
set_prefix(Prefix, Start) :-
    retractall(rdf_db:ns(Prefix, _)),
    (   Start == none -> true ; asserta(rdf_db:ns(Prefix, Start)) ),
    forall(rdf_prefixes:rdf_empty_prefix_cache(Prefix, Start), true).

rdf_register_prefix(Prefix, Start) :- rdf_register_prefix(Prefix, Start, []).

% rdf_register_prefix(+Prefix, +Start, +Options): replaces a prefix, except with keep(true).
rdf_register_prefix(First-Second, Start, Options) :- !,  % a name with a hyphen that is not quoted
    atomic_list_concat([First, Second], -, Prefix),
    rdf_register_prefix(Prefix, Start, Options).
rdf_register_prefix(Prefix, Start, Options) :-
    must_be(atom, Prefix),
    must_be(atom, Start),
    (   option(keep(true), Options), known_prefix(Prefix, _) -> true
    ;   set_prefix(Prefix, Start),
        retractall(registered(Prefix)),
        assertz(registered(Prefix))
    ).

rdf_register_ns(Prefix, Start) :- rdf_register_prefix(Prefix, Start).
rdf_register_ns(Prefix, Start, Options) :- rdf_register_prefix(Prefix, Start, Options).
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
    ;   throw_unknown_prefix(Prefix)
    ).
expand(Term, Expanded) :-
    compound_name_arguments(Term, Name, Arguments),
    maplist(expand, Arguments, Written),
    compound_name_arguments(Expanded, Name, Written).

throw_unknown_prefix(Prefix) :-
    findall(Known, known_prefix(Known, _), All),
    format(string(Sentence), "unknown prefix ~q; known prefixes: ~w; rdf_register_prefix(Prefix, Iri) adds one",
           [Prefix, All]),
    throw(mindstage_error('NameNotFoundError', Sentence)).

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
