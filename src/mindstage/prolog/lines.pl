% Lines that strangers may ask, such as visitors of a page: questions, and what joins them.
%
% A line is read as a term, and each goal in it is looked up here before anything runs. What is not found here is
% refused: nothing in a line can call, change, read or write anything, whatever it is bound to later on.

:- module(mindstage_lines, [line_goal/3, bounded/1]).
:- use_module(library(aggregate)).
:- use_module(library(error)).
:- use_module(library(lists)).

most_letters(4000).
most_inferences(5000000).

% line_goal(+Text, -Variables, -Goal): what may be run; a syntax error, or mindstage_error(goal_refused, Sentence).
line_goal(Text, Variables, Goal) :-
    string_length(Text, Length),
    most_letters(Most),
    (   Length > Most -> refuse("a line has at most ~w letters, not ~w", [Most, Length]) ; true ),
    % Text in {| |} would be given to a parser of its own while it is read.
    (   sub_string(Text, _, _, _, "{|") -> refuse("{| |} cannot be asked here", []) ; true ),
    term_string(Term, Text, [variable_names(Variables), module(mindstage_lines)]),
    (   Term == end_of_file -> syntax_error(end_of_file) ; true ),
    safe(Term, Goal).

% bounded(:Goal): throws where it takes more steps than anybody needs.
bounded(Goal) :-
    most_inferences(Most),
    call_with_inference_limit(mindstage_lines:Goal, Most, Result),
    (   Result == inference_limit_exceeded -> refuse("it takes more than ~D steps; ask for less", [Most]) ; true ).

% safe(?Term, -Goal): what is run for it.
safe(Term, _) :- var(Term), !, refuse("what is to be asked must be written down, not left to a variable", []).
safe((A, B), (X, Y)) :- !, safe(A, X), safe(B, Y).
safe((A ; B), (X ; Y)) :- !, safe(A, X), safe(B, Y).
safe((A -> B), (X -> Y)) :- !, safe(A, X), safe(B, Y).
safe(\+ A, \+ X) :- !, safe(A, X).
safe(forall(A, B), forall(X, Y)) :- !, safe(A, X), safe(B, Y).
safe(findall(Template, A, List), findall(Template, X, List)) :- !, safe(A, X).
safe(aggregate_all(count, A, Count), aggregate_all(count, X, Count)) :- !, safe(A, X).
safe(length(List, Length), (is_list(List), length(List, Length))) :- !.
safe(Term, (number(A), number(B), Term)) :- comparison(Term, A, B), !.
safe(Term, Term) :- plain(Term), !.
safe(Term, (acyclic_term(Term), mindstage:Term)) :- callable(Term), asked(Term), !.
safe(Term, _) :-
    (   callable(Term) -> functor(Term, Name, Arity), What = Name/Arity ; What = Term ),
    refuse("~q cannot be asked here, only questions, joined by , ; -> \\+ = \\= == < > member length findall forall", [What]).

% A comparison would work out what its sides are bound to; numbers are worked out already.
comparison(A < B, A, B).
comparison(A > B, A, B).
comparison(A =< B, A, B).
comparison(A >= B, A, B).
comparison(A =:= B, A, B).
comparison(A =\= B, A, B).

plain(true).
plain(fail).
plain(false).
plain(_ = _).
plain(_ \= _).
plain(_ == _).
plain(_ \== _).
plain(_ @< _).
plain(_ @> _).
plain(_ @=< _).
plain(_ @>= _).
plain(member(_, _)).
plain(memberchk(_, _)).
plain(msort(_, _)).
plain(sort(_, _)).
plain(nonvar(_)).
plain(var(_)).

% asked(+Head): a declared question, or one of those that have another name in the thesis.
asked(map_instance(_)).
asked(map_root_object(_, _)).
asked(get_subclass_in_map(_, _, _)).
asked(likely_storage_place(_, _)).
asked(likely_storage_place_in_environment(_, _, _)).
asked(owl_class_properties(_, _, _)).
asked(analyse_semantic_map(_, _, _, _, _, _)).
asked(identical_maps(_, _)).
asked(identical_maps(_, _, _)).
asked(Head) :-
    functor(Head, Name, Arity),
    functor(General, Name, Arity),
    predicate_property(mindstage:General, defined),
    \+ predicate_property(mindstage:General, imported_from(_)),
    catch(clause(mindstage:General, mindstage_asking:question(Name, _)), _, fail).

refuse(Format, Arguments) :-
    format(string(Sentence), Format, Arguments),
    throw(mindstage_error(goal_refused, Sentence)).
