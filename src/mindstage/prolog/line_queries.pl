% Queries from untrusted clients, such as the viewer: conjunctions and other combinations of questions.
%
% A query is parsed to a term, and each goal in it is checked against an allowlist before anything runs. A goal that is not
% listed is an error: a query cannot call, change, read or write anything else, whatever its variables are bound to.

:- module(mindstage_line_queries, [query_goal/3, call_bounded/1]).
:- use_module(library(aggregate)).
:- use_module(library(error)).
:- use_module(library(lists)).

max_characters(4000).
max_inferences(5000000).

% query_goal(+Text, -Variables, -Goal): the checked goal; throws a syntax error or mindstage_error(goal_refused, Sentence).
query_goal(Text, Variables, Goal) :-
    string_length(Text, Length),
    max_characters(Most),
    (   Length > Most -> throw_goal_refused("a query has at most ~w characters, not ~w", [Most, Length]) ; true ),
    % Quasi quotations, {| |}, call a parser while the text is read.
    (   sub_string(Text, _, _, _, "{|") -> throw_goal_refused("{| |} cannot be asked here", []) ; true ),
    term_string(Term, Text, [variable_names(Variables), module(mindstage_line_queries)]),
    (   Term == end_of_file -> syntax_error(end_of_file) ; true ),
    checked_goal(Term, Goal).

% call_bounded(:Goal): calls a goal with a limit of inferences.
call_bounded(Goal) :-
    max_inferences(Most),
    call_with_inference_limit(mindstage_line_queries:Goal, Most, Result),
    (   Result == inference_limit_exceeded -> throw_goal_refused("the query takes more than ~D inferences; narrow it", [Most]) ; true ).

% checked_goal(?Term, -Goal): the goal to run for a term of the query.
checked_goal(Term, _) :- var(Term), !, throw_goal_refused("a goal must not be a variable", []).
checked_goal((A, B), (X, Y)) :- !, checked_goal(A, X), checked_goal(B, Y).
checked_goal((A ; B), (X ; Y)) :- !, checked_goal(A, X), checked_goal(B, Y).
checked_goal((A -> B), (X -> Y)) :- !, checked_goal(A, X), checked_goal(B, Y).
checked_goal(\+ A, \+ X) :- !, checked_goal(A, X).
checked_goal(forall(A, B), forall(X, Y)) :- !, checked_goal(A, X), checked_goal(B, Y).
checked_goal(findall(Template, A, List), findall(Template, X, List)) :- !, checked_goal(A, X).
checked_goal(aggregate_all(count, A, Count), aggregate_all(count, X, Count)) :- !, checked_goal(A, X).
checked_goal(length(List, Length), (is_list(List), length(List, Length))) :- !.
checked_goal(Term, (number(A), number(B), Term)) :- comparison(Term, A, B), !.
checked_goal(Term, Term) :- allowed_builtin(Term), !.
checked_goal(Term, (acyclic_term(Term), mindstage:Term)) :- callable(Term), allowed_question(Term), !.
checked_goal(Term, _) :-
    (   callable(Term) -> functor(Term, Name, Arity), What = Name/Arity ; What = Term ),
    throw_goal_refused("~q cannot be asked here, only questions combined with , ; -> \\+ = \\= == < > member length findall forall", [What]).

% Comparisons are limited to numbers, since they evaluate arithmetic expressions.
comparison(A < B, A, B).
comparison(A > B, A, B).
comparison(A =< B, A, B).
comparison(A >= B, A, B).
comparison(A =:= B, A, B).
comparison(A =\= B, A, B).

allowed_builtin(true).
allowed_builtin(fail).
allowed_builtin(false).
allowed_builtin(_ = _).
allowed_builtin(_ \= _).
allowed_builtin(_ == _).
allowed_builtin(_ \== _).
allowed_builtin(_ @< _).
allowed_builtin(_ @> _).
allowed_builtin(_ @=< _).
allowed_builtin(_ @>= _).
allowed_builtin(member(_, _)).
allowed_builtin(memberchk(_, _)).
allowed_builtin(msort(_, _)).
allowed_builtin(sort(_, _)).
allowed_builtin(nonvar(_)).
allowed_builtin(var(_)).

% allowed_question(+Head): a declared question, or a question under its name in the thesis.
allowed_question(map_instance(_)).
allowed_question(map_root_object(_, _)).
allowed_question(get_subclass_in_map(_, _, _)).
allowed_question(likely_storage_place(_, _)).
allowed_question(likely_storage_place_in_environment(_, _, _)).
allowed_question(owl_class_properties(_, _, _)).
allowed_question(analyse_semantic_map(_, _, _, _, _, _)).
allowed_question(identical_maps(_, _)).
allowed_question(identical_maps(_, _, _)).
allowed_question(Head) :-
    functor(Head, Name, Arity),
    functor(General, Name, Arity),
    predicate_property(mindstage:General, defined),
    \+ predicate_property(mindstage:General, imported_from(_)),
    catch(clause(mindstage:General, mindstage_questions:question(Name, _)), _, fail).

throw_goal_refused(Format, Arguments) :-
    format(string(Sentence), Format, Arguments),
    throw(mindstage_error(goal_refused, Sentence)).
