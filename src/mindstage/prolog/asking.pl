% How Prolog asks Python, and how every declared question becomes a predicate.
%
% python/2 is foreign. It takes a request and always succeeds, with told(Answer), unknown(Name, Sentence),
% refused(Kind, Sentence) or interrupted.

:- module(mindstage_asking, [request/2, question/2, answers/1, answers/2, define_questions/0, questions/0,
                             why/1, missing/2]).
:- use_module(names).
:- use_module(library(apply)).
:- use_module(library(error)).
:- use_module(library(lists)).

:- dynamic warned/1, described/2.

% request(+Request, -Answer): true, false where nobody knows a name, or a thrown mindstage_error(Kind, Sentence).
request(Request, Answer) :-
    spelt(Request, Spelt),
    python(Spelt, Reply),
    settled(Reply, Answer).

settled(told(Answer), Answer).
settled(unknown(Name, Sentence), _) :- warn(Name, Sentence), fail.
settled(refused(Kind, Sentence), _) :- throw(mindstage_error(Kind, Sentence)).
settled(interrupted, _) :- throw(mindstage_interrupted).

% A name that nobody knows makes a question false, as it does in any store of triples; whoever types hears of it once.
warn(Name, _) :- warned(Name), !.
warn(Name, Sentence) :- assertz(warned(Name)), print_message(warning, mindstage_unknown(Sentence)).

% question(+Name, ?Arguments): the rows, one after the other.
question(Name, Arguments) :-
    spelt(Arguments, Given),
    request(rows(Name, Given), Rows),
    member(Given, Rows).

% answers(+Request): Python's answers are the arguments; answers(+Request, ?Columns): the columns.
answers(Request) :-
    spelt(Request, Given),
    Given =.. [_|Columns],
    request(Given, Rows),
    member(Columns, Rows).
answers(Request, Columns) :-
    spelt(Columns, Given),
    request(Request, Rows),
    member(Given, Rows).

%!  why(+Question) is semidet.
%
%   Prints the answers to a question, and what led to each; false, after what is missing, where there is none.
why(Question) :-
    must_be(callable, Question),
    spelt(Question, Given),
    Given =.. [Name|Arguments],
    request(reasons(Name, Arguments), Reasons),
    findall(Arguments-Lines, member([Arguments, Lines], Reasons), Told),
    forall(member(Row-Lines, Told),
           ( Answer =.. [Name|Row], format("~p~n", [Answer]), forall(member(Line, Lines), format("    ~w~n", [Line])) )),
    (   Told == []
    ->  forall(missing(Question, Sentence), format("missing: ~w~n", [Sentence])),
        fail
    ;   true
    ).

%!  missing(+Question, -Sentence) is nondet.
%
%   What nobody has told yet, for want of which a question has no answer.
missing(Question, Sentence) :-
    must_be(callable, Question),
    spelt(Question, Given),
    Given =.. [Name|Arguments],
    request(missing(Name, Arguments), Sentences),
    member(Sentence, Sentences).

% -- predicates --------------------------------------------------------------------------------------------------------

% Module `mindstage` holds what people call. It is where `user`, and so every module of theirs, looks for what it does
% not define itself: their own definition of a name always comes first.
define_questions :-
    request(predicates, Predicates),
    retractall(described(_, _)),
    retractall(warned(_)),
    forall(member(predicate(Name, Columns, Arguments, Text), Predicates), define(Name, Columns, Arguments, Text)).

define(Name, Columns, Arguments, Text) :-
    length(Columns, All),
    forall(( member(Arity, [Arguments, All]), \+ taken(Name, Arity) ), define(Name, Arity)),
    length(Shown, Arguments),
    append(Shown, _, Columns),
    Head =.. [Name|Shown],
    assertz(described(Head, Text)).

% What the thesis means by a name comes before a question that happens to be called the same.
taken(Name, Arity) :- functor(Head, Name, Arity), predicate_property(mindstage:Head, visible).

define(Name, Arity) :-
    functor(Head, Name, Arity),
    Head =.. [_|Arguments],
    assertz((mindstage:Head :- mindstage_asking:question(Name, Arguments))),
    compile_predicates([mindstage:Name/Arity]).

%!  questions is det.
%
%   Lists the questions and what they answer.
questions :-
    forall(described(Head, Text), ( shown(Head, Shown), format("~w~t~60| ~w~n", [Shown, Text]) )).

shown(Head, Shown) :-
    Head =.. [Name|Columns],
    maplist(variable, Columns, Variables),
    atomic_list_concat(Variables, ', ', Inner),
    format(atom(Shown), "~w(~w)", [Name, Inner]).

variable(cls, 'Class') :- !.
variable(Column, Variable) :-
    sub_atom(Column, 0, 1, Rest, First),
    sub_atom(Column, 1, Rest, 0, Tail),
    upcase_atom(First, Upper),
    atom_concat(Upper, Tail, Variable).
