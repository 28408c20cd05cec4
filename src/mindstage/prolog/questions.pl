% Requests from Prolog to Python, and the declared questions as predicates.
%
% python/2 is a foreign predicate. It always succeeds, with one of answer(Answer), unknown_name(Name, Sentence),
% error_reply(Kind, Sentence) or interrupted.

:- module(mindstage_questions, [request/2, question/2, answers/1, answers/2, define_questions/0, questions/0,
                             why/1, missing/2, ask_sentence/2, ask_sentence/3]).
:- use_module(prefixes).
:- use_module(library(apply)).
:- use_module(library(error)).
:- use_module(library(lists)).

:- dynamic warned/1, described/2.

% request(+Request, -Answer): fails if a name is unknown; throws mindstage_error(Kind, Sentence) on errors.
request(Request, Answer) :-
    expand_prefixes(Request, Expanded),
    python(Expanded, Reply),
    reply_result(Reply, Answer).

reply_result(answer(Answer), Answer).
reply_result(unknown_name(Name, Sentence), _) :- warn_once(Name, Sentence), fail.
reply_result(error_reply(Kind, Sentence), _) :- throw(mindstage_error(Kind, Sentence)).
reply_result(interrupted, _) :- throw(mindstage_interrupted).

% A question about an unknown name fails, as in any triple store. A warning is printed once for each name.
warn_once(Name, _) :- warned(Name), !.
warn_once(Name, Sentence) :- assertz(warned(Name)), print_message(warning, mindstage_unknown_name(Sentence)).

% question(+Name, ?Arguments): enumerates the rows.
question(Name, Arguments) :-
    expand_prefixes(Arguments, Given),
    request(rows(Name, Given), Rows),
    member(Given, Rows).

% answers(+Request): enumerates rows that are unified with the request's arguments; answers(+Request, ?Columns): with Columns.
answers(Request) :-
    expand_prefixes(Request, Given),
    Given =.. [_|Columns],
    request(Given, Rows),
    member(Columns, Rows).
answers(Request, Columns) :-
    expand_prefixes(Columns, Given),
    request(Request, Rows),
    member(Given, Rows).

%!  why(+Question) is semidet.
%
%   Prints the answers to a question with their explanations. Without answers, prints the missing facts and fails.
why(Question) :-
    must_be(callable, Question),
    expand_prefixes(Question, Given),
    Given =.. [Name|Arguments],
    request(reasons(Name, Arguments), Reasons),
    findall(Arguments-Lines, member([Arguments, Lines], Reasons), Answers),
    forall(member(Row-Lines, Answers),
           ( Answer =.. [Name|Row], format("~p~n", [Answer]), forall(member(Line, Lines), format("    ~w~n", [Line])) )),
    (   Answers == []
    ->  forall(missing(Question, Sentence), format("missing: ~w~n", [Sentence])),
        fail
    ;   true
    ).

%!  missing(+Question, -Sentence) is nondet.
%
%   A fact that is missing from the knowledge base, without which the question has no answer.
missing(Question, Sentence) :-
    must_be(callable, Question),
    expand_prefixes(Question, Given),
    Given =.. [Name|Arguments],
    request(missing(Name, Arguments), Sentences),
    member(Sentence, Sentences).

%!  ask_sentence(+Sentence, -Answer) is nondet.
%!  ask_sentence(+Sentence, -Answer, -Understood) is nondet.
%
%   The answers to a plain sentence, such as "where is the milk?": each is a goal of the question with all its columns.
%   Understood is the question as it was understood, with the arguments bound that the sentence gives. Fails without an
%   answer; throws if the sentence is not understood, or ambiguous.
ask_sentence(Sentence, Answer) :- ask_sentence(Sentence, Answer, _).
ask_sentence(Sentence, Answer, Understood) :-
    must_be(text, Sentence),
    text_to_string(Sentence, String),
    atom_string(Text, String),
    request(sentence(Text), understood(Name, Given, Rows)),
    Understood =.. [Name|Given],
    member(Row, Rows),
    Answer =.. [Name|Row].

% -- predicates --------------------------------------------------------------------------------------------------------

% Module `mindstage` has the predicates for users. It is a default import module of `user`, and so of all modules of
% users: their own definitions take precedence.
define_questions :-
    request(predicates, Predicates),
    retractall(described(_, _)),
    retractall(warned(_)),
    forall(member(predicate(Name, Columns, Arguments, Text), Predicates), define(Name, Columns, Arguments, Text)).

define(Name, Columns, Arguments, Text) :-
    length(Columns, All),
    forall(( member(Arity, [Arguments, All]), \+ is_taken(Name, Arity) ), define(Name, Arity)),
    length(Shown, Arguments),
    append(Shown, _, Columns),
    Head =.. [Name|Shown],
    assertz(described(Head, Text)).

% Predicates of veit2019_compat.pl take precedence over questions of the same name.
is_taken(Name, Arity) :- functor(Head, Name, Arity), predicate_property(mindstage:Head, visible).

define(Name, Arity) :-
    functor(Head, Name, Arity),
    Head =.. [_|Arguments],
    assertz((mindstage:Head :- mindstage_questions:question(Name, Arguments))),
    compile_predicates([mindstage:Name/Arity]).

%!  questions is det.
%
%   Lists the questions with their descriptions.
questions :-
    forall(described(Head, Text), ( shown(Head, Shown), format("~w~t~60| ~w~n", [Shown, Text]) )).

shown(Head, Shown) :-
    Head =.. [Name|Columns],
    maplist(variable_name, Columns, Variables),
    atomic_list_concat(Variables, ', ', Inner),
    format(atom(Shown), "~w(~w)", [Name, Inner]).

variable_name(cls, 'Class') :- !.
variable_name(Column, Variable) :-
    sub_atom(Column, 0, 1, Rest, First),
    sub_atom(Column, 1, Rest, 0, Tail),
    upcase_atom(First, Upper),
    atom_concat(Upper, Tail, Variable).
